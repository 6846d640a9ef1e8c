"""Which candidates are under the terrain of a request."""

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry import ground as engine
from fvs_schema.error_codes import FieldError
from fvs_schema.terrain import AnyTerrain, Terrain, TerrainOfPoints
from fvs_service.errors import InvalidRequestError
from fvs_service.scenes.poses import WorldFrame, geodetic_origin


def require_datum(terrain: Terrain, frame: WorldFrame) -> None:
    """Raise ``InvalidRequestError`` for a terrain above another datum than a scene's altitudes."""
    datum = frame.require_origin().altitude_datum
    with _about("terrain.altitude_datum", f"it is not {datum.value}"):
        engine.require_datum(terrain, datum)


def kept(terrain: AnyTerrain | None) -> TerrainOfPoints | None:
    """What rankings and plans keep of a request's terrain: no heights."""
    return terrain if isinstance(terrain, TerrainOfPoints) else None


def ground_check(
    poses: Mapping[str, RigidTransform], frame: WorldFrame, terrain: Terrain | None
) -> engine.GroundCheck:
    """Compare world_from_camera ``poses``, by id, with the terrain of a request, if it has one.

    Raises ``InvalidRequestError`` for a terrain that has a height at none of them.
    """
    if terrain is None:
        return engine.GroundCheck()
    positions_m = {name: pose.translation for name, pose in poses.items()}
    with _about("terrain", "it has no height at the candidates"):
        return engine.GroundCheck.of(positions_m, geodetic_origin(frame.require_origin()), terrain)


@contextmanager
def _about(field: str, message: str) -> Iterator[None]:
    try:
        yield
    except InvalidInputError as error:
        errors = [FieldError(field, message)]
        raise InvalidRequestError(error.message, hint=error.hint, errors=errors) from error
