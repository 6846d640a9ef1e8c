"""Messages of ROS 2 as JSON, as ``ros2 topic pub`` and rosbridge read them.

The frame ``map`` is the world frame: ENU (REP 103, REP 105), in metres, at the scene's origin. A pose is that
of a body that looks where the camera looks: FLU, x forward along the viewing direction, y left, z up.
"""

from typing import Any

import numpy as np
import orjson
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform, quaternion_from_matrix
from fvs_service.missions.camera_poses import CameraPoses

_CAMERA_FROM_BODY: NDArray[np.float64] = np.array([[0.0, -1.0, 0.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
"""Forward is the camera's z, left its -x, up its -y."""
_HEADER = {"stamp": {"sec": 0, "nanosec": 0}, "frame_id": "map"}


def write_pose_array(poses: CameraPoses) -> bytes:
    """A ``geometry_msgs/PoseArray``."""
    found = [_pose(camera) for camera in poses.world_from_cameras]
    return orjson.dumps({"header": _HEADER, "poses": found})


def write_poses_stamped(poses: CameraPoses) -> bytes:
    """A list of ``geometry_msgs/PoseStamped``: what ``nav_msgs/Path`` has as its poses."""
    found = [{"header": _HEADER, "pose": _pose(camera)} for camera in poses.world_from_cameras]
    return orjson.dumps(found)


def _pose(world_from_camera: RigidTransform) -> dict[str, Any]:
    x, y, z = world_from_camera.translation.tolist()
    w, i, j, k = quaternion_from_matrix(world_from_camera.rotation @ _CAMERA_FROM_BODY).tolist()
    return {"position": {"x": x, "y": y, "z": z}, "orientation": {"x": i, "y": j, "z": k, "w": w}}
