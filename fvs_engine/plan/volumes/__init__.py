"""Volumes: where candidates may be, and where nothing may fly.

They are values of any frame: lengths are in its unit, and each says which direction is up. ``moved`` takes a
volume to another frame, from the world to the model for example.
"""

from typing import Annotated

from pydantic import Field, TypeAdapter, ValidationError

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.volumes.box import Box
from fvs_engine.plan.volumes.corridor import Corridor
from fvs_engine.plan.volumes.cylinder import Cylinder
from fvs_engine.plan.volumes.prism import Prism
from fvs_engine.plan.volumes.shell import Shell
from fvs_engine.records import first_error

__all__ = [
    "AnyVolume",
    "Box",
    "Corridor",
    "Cylinder",
    "Prism",
    "Shell",
    "Volume",
    "volume_from_json",
]

Volume = Annotated[Box | Cylinder | Prism | Shell | Corridor, Field(discriminator="kind")]
AnyVolume = Box | Cylinder | Prism | Shell | Corridor

_VOLUME: TypeAdapter[AnyVolume] = TypeAdapter(Volume)


def volume_from_json(text: str | bytes) -> AnyVolume:
    """The volume of a JSON object with its ``kind``. Raises ``InvalidInputError`` saying what is wrong."""
    try:
        return _VOLUME.validate_json(text)
    except ValidationError as error:
        raise InvalidInputError(
            f"The volume cannot be used: {first_error(error, 'the volume')}.",
            hint="A volume is a box, cylinder, prism, shell or corridor with a positive extent.",
        ) from error
