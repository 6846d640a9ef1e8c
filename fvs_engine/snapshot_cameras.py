"""The cameras of a snapshot of the service as the engine's: conversions of ``SnapshotCameras``."""

import numpy as np

from fvs_engine.geometry import PinholeCamera, RigidTransform, matrix_from_quaternion
from fvs_schema.snapshots import PinholeIntrinsics, SnapshotCameras


def intrinsics_of(camera: PinholeCamera) -> PinholeIntrinsics:
    """The intrinsics of an engine's camera."""
    return PinholeIntrinsics(
        width_px=camera.width,
        height_px=camera.height,
        fx_px=camera.fx,
        fy_px=camera.fy,
        cx_px=camera.cx,
        cy_px=camera.cy,
    )


def usual_camera(cameras: SnapshotCameras) -> PinholeCamera:
    """The camera of most images."""
    one = cameras.camera
    return PinholeCamera(one.width_px, one.height_px, one.fx_px, one.fy_px, one.cx_px, one.cy_px)


def model_from_cameras(cameras: SnapshotCameras) -> tuple[RigidTransform, ...]:
    """The poses of the views, in their order."""
    rotations = matrix_from_quaternion(
        np.array([view.orientation_wxyz for view in cameras.views]).reshape(-1, 4)
    )
    return tuple(
        RigidTransform(rotation, np.array(view.position))
        for rotation, view in zip(rotations, cameras.views, strict=True)
    )
