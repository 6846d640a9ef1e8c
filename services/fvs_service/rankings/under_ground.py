"""Which candidates are under the terrain of a request."""

from collections.abc import Mapping

from fvs_engine.geometry import RigidTransform
from fvs_schema.error_codes import FieldError
from fvs_schema.poses import VehiclePose
from fvs_schema.terrain import Terrain
from fvs_service.errors import InvalidRequestError
from fvs_service.scenes.poses import WorldFrame


def require_datum(terrain: Terrain, frame: WorldFrame) -> None:
    """Raise ``InvalidRequestError`` for a terrain above another datum than a scene's altitudes."""
    datum = frame.require_origin().altitude_datum
    if terrain.altitude_datum is not datum:
        raise InvalidRequestError(
            f"Heights of the terrain are above {terrain.altitude_datum.value}, the scene's altitudes above "
            f"{datum.value}.",
            hint="Add the difference to its heights, and give the scene's datum as its altitude_datum.",
            errors=[FieldError("terrain.altitude_datum", f"it is not {datum.value}")],
        )


def under_ground(poses: Mapping[str, RigidTransform], frame: WorldFrame, terrain: Terrain) -> frozenset[str]:
    """The ids of world_from_camera ``poses`` that are below the ground."""
    geodetic = frame.poses(list(poses.values()), "geodetic")
    return frozenset(
        name
        for name, pose in zip(poses, geodetic, strict=True)
        if isinstance(pose, VehiclePose)
        and (ground_m := terrain.height_m((pose.latitude_deg, pose.longitude_deg))) is not None
        and pose.altitude_m < ground_m
    )
