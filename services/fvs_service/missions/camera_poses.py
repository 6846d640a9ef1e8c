"""Views as poses of cameras in the world frame, for robots and tools that know no latitudes."""

from dataclasses import dataclass

from fvs_engine.geometry import RigidTransform
from fvs_schema.snapshots import PinholeIntrinsics


@dataclass(frozen=True)
class CameraPoses:
    """Views to photograph, in order: ``world_from_cameras`` of OpenCV cameras, by ``names``.

    ``camera`` is that of the scene's images; None when the snapshot was deleted.
    """

    names: tuple[str, ...]
    world_from_cameras: tuple[RigidTransform, ...]
    camera: PinholeIntrinsics | None
