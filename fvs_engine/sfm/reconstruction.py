"""A reconstruction in memory: views and sparse points."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.views import AnyView


@dataclass(frozen=True, eq=False)
class PointCloud:
    """Points ``xyz`` [P, 3] in the model frame with ``colors`` [P, 3] uint8."""

    xyz: NDArray[np.float64]
    colors: NDArray[np.uint8]

    def __len__(self) -> int:
        return len(self.xyz)

    @staticmethod
    def empty() -> "PointCloud":
        """No points."""
        return PointCloud(np.zeros((0, 3)), np.zeros((0, 3), dtype=np.uint8))

    def and_also(self, others: "PointCloud") -> "PointCloud":
        """These points and ``others``."""
        return PointCloud(
            np.concatenate([self.xyz, others.xyz]), np.concatenate([self.colors, others.colors])
        )


@dataclass(frozen=True, eq=False)
class Reconstruction:
    """Views sorted by name, and sparse points with their mean reprojection errors [P]."""

    views: tuple[AnyView, ...]
    points: PointCloud
    point_errors_px: NDArray[np.float64]

    @staticmethod
    def of_views(views: Iterable[AnyView]) -> "Reconstruction":
        """A reconstruction without points."""
        ordered = tuple(sorted(views, key=lambda view: view.name))
        return Reconstruction(ordered, PointCloud.empty(), np.zeros(0))

    def centres(self) -> dict[str, NDArray[np.float64]]:
        """Name → camera centre [3]."""
        return {view.name: view.centre for view in self.views}
