"""Cameras: OpenCV axes (x right, y down, z forward); the top left corner of the image is (0, 0) px.

The centre of the top left pixel is therefore at (0.5, 0.5), as in COLMAP and gsplat.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class PinholeCamera:
    """A camera without distortion: ``width`` × ``height`` px, focal lengths and principal point in px."""

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float

    @property
    def matrix(self) -> NDArray[np.float64]:
        """K [3, 3]."""
        return np.array([[self.fx, 0.0, self.cx], [0.0, self.fy, self.cy], [0.0, 0.0, 1.0]])

    def resized(self, width: int, height: int) -> "PinholeCamera":
        """The same view on another pixel grid."""
        sx, sy = width / self.width, height / self.height
        return PinholeCamera(width, height, self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)
