"""From a snapshot's cameras, in the model's frame, to what a ranking needs to know of the world."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import PinholeCamera, RigidTransform, angle_between, matrix_from_quaternion
from fvs_service.rankings.generators import Surroundings
from fvs_service.scenes.poses import WorldFrame
from fvs_service.snapshots.model import PinholeIntrinsics, SnapshotCameras

Array = NDArray[np.float64]

_SAME_PLACE = 0.05
"""Of the usual distance between neighbouring images."""
_SAME_DIRECTION_RAD = np.deg2rad(3.0)


def surroundings(frame: WorldFrame, cameras: SnapshotCameras) -> Surroundings:
    """The registered cameras and what they look at, in the world's frame."""
    world_from_model = frame.world_from_model
    centre = world_from_model.apply(cameras.centre)
    up = np.array([0.0, 0.0, 1.0]) if frame.aligned else np.array(cameras.up)
    level = _level_axes(up)
    low, high = np.array(cameras.lower), np.array(cameras.upper)
    corners = np.array([[(low, high)[bit >> axis & 1][axis] for axis in range(3)] for bit in range(8)])
    box = world_from_model.apply(corners) @ level
    return Surroundings(
        cameras=tuple(
            world_from_model.move_camera(
                RigidTransform(matrix_from_quaternion(view.orientation_wxyz), np.array(view.position))
            )
            for view in cameras.views
        ),
        centre=centre,
        level=level,
        lower=box.min(axis=0),
        upper=box.max(axis=0),
    )


def pinhole(intrinsics: PinholeIntrinsics) -> PinholeCamera:
    """The camera that candidates are rendered with."""
    return PinholeCamera(
        intrinsics.width_px,
        intrinsics.height_px,
        intrinsics.fx_px,
        intrinsics.fy_px,
        intrinsics.cx_px,
        intrinsics.cy_px,
    )


def visited_among(poses: Mapping[str, RigidTransform], around: Surroundings) -> frozenset[str]:
    """Those at which an image was taken: at the same place, looking the same way.

    ``poses`` are id → world_from_camera.
    """
    if not poses:
        return frozenset()
    near = around.places.query_ball_point(
        np.stack([pose.translation for pose in poses.values()]), _SAME_PLACE * _spacing(around)
    )
    return frozenset(
        name
        for (name, pose), indices in zip(poses.items(), near, strict=True)
        if any(
            angle_between(around.cameras[index].rotation, pose.rotation) <= _SAME_DIRECTION_RAD
            for index in indices
        )
    )


def _spacing(around: Surroundings) -> float:
    """Median distance from an image to its nearest neighbour."""
    if len(around.cameras) < 2:
        return 0.0
    distances, _ = around.places.query(around.centres, k=2)
    return float(np.median(distances[:, 1]))


def _level_axes(up: Array) -> Array:
    """Columns x, y and up; with z up they are east, north and up."""
    z = up / np.linalg.norm(up)
    start = np.eye(3)[0] if abs(z[0]) < 0.9 else np.eye(3)[1]
    x = start - z * (start @ z)
    x /= np.linalg.norm(x)
    return np.column_stack([x, np.cross(z, x), z])
