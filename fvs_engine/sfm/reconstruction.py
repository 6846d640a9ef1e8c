"""A reconstruction in memory: views and sparse points."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.views import AnyView


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Views sorted by name, and sparse ``points`` [P, 3] with ``point_colors`` [P, 3] and errors [P]."""

    views: tuple[AnyView, ...]
    points: NDArray[np.float64]
    point_colors: NDArray[np.uint8]
    point_errors_px: NDArray[np.float64]

    def centres(self) -> dict[str, NDArray[np.float64]]:
        """Name → camera centre [3]."""
        return {view.name: view.centre for view in self.views}
