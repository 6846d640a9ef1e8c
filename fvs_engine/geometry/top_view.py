"""A map of a scene from above."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

_MIN_UPRIGHT = 0.3
"""Length of the cameras' mean up vector under which they have no common up (nadir views)."""


class TopView:
    """The plane that is seen along the cameras' common up direction.

    ``centres`` [N, 3] and rotations camera_from_model [N, 3, 3]; the longest direction of the centres is to
    the right. Where there is no common up (a nadir block),
    the plane is seen along the direction in which the centres vary least, against the viewing direction.
    """

    def __init__(self, centres: Array, rotations: Array) -> None:
        up = -rotations[:, 1].mean(axis=0)
        self._middle = centres.mean(axis=0)
        offsets = centres - self._middle
        _, _, axes = np.linalg.svd(offsets.T @ offsets)  # of 3 × 3, whatever the number of centres
        if np.linalg.norm(up) < _MIN_UPRIGHT:
            up = axes[2] if rotations[:, 2].mean(axis=0) @ axes[2] < 0 else -axes[2]
        up = up / np.linalg.norm(up)
        right = axes[0] - (axes[0] @ up) * up
        if np.linalg.norm(right) < 1e-6:
            right = axes[1] - (axes[1] @ up) * up
        right /= np.linalg.norm(right)
        self._across = np.stack([right, np.cross(up, right)])  # the map is not mirrored

    def project(self, points: Array) -> Array:
        """Points [N, 3] on the map [N, 2]."""
        return np.asarray((points - self._middle) @ self._across.T)
