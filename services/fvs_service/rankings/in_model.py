"""Conversion of volumes and vehicles' constraints from the world frame of requests to the model frame."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from pydantic import ValidationError

from fvs_engine.geometry import PinholeCamera
from fvs_engine.plan.volumes import AnyVolume
from fvs_engine.records import first_error
from fvs_service.errors import InvalidRequestError
from fvs_service.rankings.model import InVolume
from fvs_service.rankings.port import Clearance, ViewsInVolume
from fvs_service.scenes.poses import WorldFrame


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


def clearance(safety_m: float | None, no_fly: Sequence[AnyVolume], frame: WorldFrame) -> Clearance:
    """The safety distance (None: 0) and the no-fly zones of a request."""
    return Clearance(
        safety=(safety_m or 0.0) / frame.world_from_model.scale,
        no_fly=tuple(_moved(zone, frame, f"No-fly zone {number}") for number, zone in enumerate(no_fly)),
    )


def _moved(volume: AnyVolume, frame: WorldFrame, what: str) -> AnyVolume:
    """A volume in the model frame; raises ``InvalidRequestError`` where its numbers make none there."""
    try:
        return volume.moved(frame.model_from_world)
    except ValidationError as error:
        raise InvalidRequestError(
            f"{what} cannot be used in the model frame: {first_error(error, 'its numbers')}",
            hint="Give a volume of the size of the scene, in coordinates of its world frame.",
        ) from error
