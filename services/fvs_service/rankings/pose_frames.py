"""The frames of the poses in an answer."""

from collections.abc import Mapping, Sequence

from fvs_engine.geometry import RigidTransform
from fvs_engine.views import PinholeView
from fvs_schema.candidates import Candidate
from fvs_schema.poses import FramePose, PoseFrame, VehiclePose, frame_of
from fvs_service.scenes.poses import WorldFrame, require_on_earth


def in_world(views: Sequence[PinholeView], frame: WorldFrame) -> Mapping[str, RigidTransform]:
    """The poses of views of the model frame: name → world_from_camera. Raises as ``require_on_earth``."""
    poses = {
        view.name: frame.world_from_model.move_camera(view.camera_from_model.inverse()) for view in views
    }
    require_on_earth(poses)
    return poses


def poses_in(
    frame: WorldFrame,
    names: Sequence[str],
    poses: Mapping[str, RigidTransform],
    given: Sequence[Candidate],
    wanted: PoseFrame | None,
    current: FramePose | VehiclePose | None,
) -> tuple[FramePose | VehiclePose, ...]:
    """The poses ``names`` of candidates, in the frame that a request ``wanted``, or in its own frame.

    ``poses`` are world_from_camera by id. Without a wanted frame the poses come back as they were ``given``;
    generated ones in the frame of the ``current`` pose, else geodetic in a georeferenced scene, else in the
    world frame.
    """
    as_given = {item.id: item.pose for item in given}
    if as_given and (wanted is None or all(frame_of(pose) == wanted for pose in as_given.values())):
        return tuple(as_given[name] for name in names)
    if wanted is None and current is not None:
        wanted = frame_of(current)
    if wanted is None:
        wanted = "geodetic" if frame.georeferenced else "world"
    return frame.poses([poses[name] for name in names], wanted)
