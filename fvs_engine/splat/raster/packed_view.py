"""A camera and its pose in the layout of the kernels."""

import numpy as np

from fvs_engine.geometry import PinholeCamera, RigidTransform


class PackedView:
    """A camera and its pose as ``vector``, float32 [19].

    Rotation (9, row-major) and translation (3) of camera_from_model, the camera's centre in the model frame
    (3), and fx, fy, cx, cy.
    """

    def __init__(self, camera: PinholeCamera, camera_from_model: RigidTransform, degree: int) -> None:
        self.size = (camera.width, camera.height)
        self.degree = degree
        self.vector = np.empty(19, np.float32)
        self.vector[0:9] = camera_from_model.rotation.ravel()
        self.vector[9:12] = camera_from_model.translation
        self.vector[12:15] = camera_from_model.inverse().translation
        self.vector[15:19] = camera.fx, camera.fy, camera.cx, camera.cy

    def tiles(self, side_px: int) -> tuple[int, int]:
        """Columns and rows of tiles of ``side_px``."""
        width, height = self.size
        return -(-width // side_px), -(-height // side_px)
