"""How far the camera flies."""

import numpy as np
from numpy.typing import ArrayLike


def path_length(centres: ArrayLike) -> float:
    """The way through camera centres [N, 3] in their order, straight from each to the next; 0 for one."""
    points = np.asarray(centres, dtype=np.float64).reshape(-1, 3)
    return float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum())
