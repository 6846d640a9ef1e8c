"""nerfstudio's ``transforms.json``: intrinsics, and a world_from_camera per view of an OpenGL camera."""

import numpy as np
import orjson

from fvs_engine.geometry import RigidTransform
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.camera_poses import CameraPoses

_OPENGL = np.array([1.0, -1.0, -1.0])
"""An OpenGL camera has y up and looks along -z."""


def write(poses: CameraPoses) -> bytes:
    """The views as a ``transforms.json``; raises ``InvalidRequestError`` without intrinsics."""
    camera = poses.camera
    if camera is None:
        raise InvalidRequestError(
            "The snapshot of the ranking was deleted, and with it the intrinsics.", hint="Rank again."
        )
    document = {
        "camera_model": "PINHOLE",
        "w": camera.width_px,
        "h": camera.height_px,
        "fl_x": camera.fx_px,
        "fl_y": camera.fy_px,
        "cx": camera.cx_px,
        "cy": camera.cy_px,
        "frames": [
            {"file_path": f"images/{name}.jpg", "transform_matrix": _matrix(world_from_camera)}
            for name, world_from_camera in zip(poses.names, poses.world_from_cameras, strict=True)
        ],
    }
    return orjson.dumps(document)


def _matrix(world_from_camera: RigidTransform) -> list[list[float]]:
    matrix = np.eye(4)
    matrix[:3, :3] = world_from_camera.rotation * _OPENGL
    matrix[:3, 3] = world_from_camera.translation
    rows: list[list[float]] = matrix.tolist()
    return rows
