"""Conversion of a runner's plan to the world frame."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.geometry import RigidTransform
from fvs_schema.poses import FramePose, VehiclePose, frame_of
from fvs_service.scenes.poses import WorldFrame


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
