"""Numbers, and the quantities of requests, each with the range in which it has a meaning.

What the service computes is not bounded by these: responses have plain finite numbers.
"""

from typing import Annotated, TypeVar

from pydantic import BeforeValidator, Field

QuantityT = TypeVar("QuantityT")

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
"""A finite number; strings are not converted."""


def _whole(value: object) -> object:
    return int(value) if isinstance(value, float) and value.is_integer() else value


WHOLE = BeforeValidator(_whole)
"""Reads ``3.0`` as 3, which is the same in JSON. After a strict ``Field`` with the range, so that the OpenAPI
document has the range too."""
Count = Annotated[int, Field(strict=True, ge=0), WHOLE]
PositiveNumber = Annotated[Number, Field(gt=0)]
Triple = tuple[Number, Number, Number]
"""Coordinates that the service computed."""
AsText = Annotated[QuantityT, Field(strict=False)]
"""A number in a query string."""

Latitude = Annotated[Number, Field(ge=-90, le=90)]
Longitude = Annotated[Number, Field(ge=-180, le=180)]
Altitude = Annotated[Number, Field(ge=-12_000, le=100_000)]
"""Altitudes from below the deepest trench to the edge of space, above any datum."""
Yaw = Annotated[Number, Field(ge=-360, le=360)]
"""Compasses count from 0 to 360, gimbals from -180 to 180."""
Tilt = Annotated[Number, Field(ge=-180, le=180)]
"""A pitch or a roll; gimbals that turn over exceed 90."""
AngleSigma = Annotated[Number, Field(ge=0, le=180)]
"""The standard deviation of an attitude about each axis."""

MAX_COORDINATE = 1e10
"""Longest translation, in any unit: squares of it, and of it in another unit, are float32 numbers."""
MAX_COORDINATE_M = 2e7
Coordinate = Annotated[Number, Field(ge=-MAX_COORDINATE_M, le=MAX_COORDINATE_M)]
"""Coordinates up to half the Earth's circumference in metres, which UTM and earth-centred ones need."""
PositionSigma = Annotated[Number, Field(ge=0, le=MAX_COORDINATE_M)]
"""The standard deviation of each coordinate of a position."""
Vector = tuple[Coordinate, Coordinate, Coordinate]
Length = Annotated[Number, Field(ge=1e-6, le=MAX_COORDINATE_M)]
"""Lengths of a micrometre or more: shorter ones are rounding at the size of a scene."""
QuaternionPart = Annotated[Number, Field(ge=-1.01, le=1.01)]
Quaternion = tuple[QuaternionPart, QuaternionPart, QuaternionPart, QuaternionPart]

MIN_SIDE_PX, MAX_SIDE_PX = 32, 32_768
"""The shortest and the longest side of an image."""
MAX_PIXELS = 256_000_000
MAX_ASPECT_RATIO = 20.0
PLAUSIBLE_SHARE = (0.1, 20.0)
"""Focal lengths outside this range, in widths of the image, are not used."""
ImageWidth = Annotated[int, Field(strict=True, ge=MIN_SIDE_PX, le=MAX_SIDE_PX), WHOLE]
"""Widths from the shortest side of an accepted image."""
FocalLength = Annotated[
    Number, Field(ge=PLAUSIBLE_SHARE[0] * MIN_SIDE_PX, le=PLAUSIBLE_SHARE[1] * MAX_SIDE_PX)
]
"""Focal lengths in px; also limited by the image's width, see ``CameraPrior``."""

Days = Annotated[Number, Field(ge=0.01, le=36_500)]
"""Ages from a quarter of an hour to a century."""

Spacing = Annotated[Number, Field(ge=0.02, le=3600)]
"""Times in s between the frames that are taken from a video."""
