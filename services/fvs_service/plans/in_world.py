"""What a runner planned, in the world frame."""

from collections.abc import Mapping, Sequence

import numpy as np

from fvs_engine.geometry import RigidTransform
from fvs_engine.views import PinholeView
from fvs_service.scenes.poses import FramePose, VehiclePose, WorldFrame, frame_of, require_on_earth


def in_world(views: Sequence[PinholeView], frame: WorldFrame) -> Mapping[str, RigidTransform]:
    """The poses of views of the model frame: name → world_from_camera. Raises as ``require_on_earth``."""
    poses = {
        view.name: frame.world_from_model.move_camera(view.camera_from_model.inverse()) for view in views
    }
    require_on_earth(poses)
    return poses


def via(
    positions: Sequence[tuple[float, float, float]],
    world_from_camera: RigidTransform,
    stop: FramePose | VehiclePose,
    frame: WorldFrame,
) -> tuple[FramePose | VehiclePose, ...]:
    """Poses at ``positions`` of the model frame, with the orientation and in the frame of a stop's pose."""
    places = [frame.world_from_model.apply(np.array(position)) for position in positions]
    return frame.poses(
        [RigidTransform(world_from_camera.rotation, place) for place in places], frame_of(stop)
    )
