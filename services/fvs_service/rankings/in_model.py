"""Conversion of volumes and vehicles' constraints from the world frame of requests to the model frame."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import TypeAdapter, ValidationError

from fvs_engine.geometry import PinholeCamera
from fvs_engine.plan.volumes import AnyVolume, Volume
from fvs_engine.records import first_error
from fvs_schema import volumes
from fvs_schema.candidates import Generator, InVolume
from fvs_schema.mistakes import field_errors, summary
from fvs_service.errors import InvalidRequestError
from fvs_service.rankings.port import Clearance, ViewsInVolume
from fvs_service.scenes.poses import WorldFrame

_VOLUME: TypeAdapter[AnyVolume] = TypeAdapter(Volume)


def require_volumes(generator: Generator | None, no_fly: Sequence[volumes.Volume] = ()) -> None:
    """Raise ``InvalidRequestError`` where the numbers of a volume in a request make none."""
    given = [("generator.volume", generator.volume)] if isinstance(generator, InVolume) else []
    for path, volume in (*given, *((f"no_fly.{number}", zone) for number, zone in enumerate(no_fly))):
        try:
            _of_engine(volume)
        except ValidationError as error:
            found = error.errors(include_url=False)
            fields = field_errors(found, (path.split(".") for _ in found))
            raise InvalidRequestError(summary(found, fields), errors=fields) from error


def views_in_volume(
    generator: InVolume, frame: WorldFrame, up: NDArray[np.float64], camera: PinholeCamera
) -> ViewsInVolume:
    """The candidates that a runner is to generate; ``up`` [3] is the upward direction in the world."""
    aim = None if generator.aim is None else frame.model_from_world.apply(np.array(generator.aim)).tolist()
    return ViewsInVolume(
        volume=_moved(generator.volume, frame, "The volume"),
        count=generator.count,
        camera=camera,
        up=tuple((frame.model_from_world.rotation @ up).tolist()),
        aim=aim or generator.look,
        level=generator.level,
    )


def clearance(safety_m: float | None, no_fly: Sequence[volumes.Volume], frame: WorldFrame) -> Clearance:
    """The safety distance (None: 0) and the no-fly zones of a request."""
    return Clearance(
        safety=(safety_m or 0.0) / frame.world_from_model.scale,
        no_fly=tuple(_moved(zone, frame, f"No-fly zone {number}") for number, zone in enumerate(no_fly)),
    )


def _moved(volume: volumes.Volume, frame: WorldFrame, what: str) -> AnyVolume:
    """A volume in the model frame; raises ``InvalidRequestError`` where its numbers make none there."""
    try:
        return _of_engine(volume).moved(frame.model_from_world)
    except ValidationError as error:
        raise InvalidRequestError(
            f"{what} cannot be used in the model frame: {first_error(error, 'its numbers')}.",
            hint="Give a volume of the size of the scene, in coordinates of its world frame.",
        ) from error


def _of_engine(volume: volumes.Volume) -> AnyVolume:
    return _VOLUME.validate_python(volume.model_dump())
