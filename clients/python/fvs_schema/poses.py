"""Poses of cameras."""

import math
from collections.abc import Mapping
from typing import Annotated, Any, Literal, Self

from pydantic import ConfigDict, Discriminator, Tag, field_validator

from fvs_schema.base import Input
from fvs_schema.quantities import Altitude, Latitude, Longitude, Quaternion, Tilt, Vector, Yaw
from fvs_schema.scenes import AltitudeDatum

_UNIT_TOLERANCE = 1e-3


class FramePose(Input):
    """A camera's pose: frame_from_camera of an OpenCV camera (x right, y down, z forward)."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [
                {"frame": "world", "position": [0.0, 0.0, -3.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}
            ]
        }
    )

    frame: Literal["world", "model"] = "world"
    """The frame of position and orientation."""
    position: Vector
    """The camera's centre, x, y, z."""
    orientation_wxyz: Quaternion
    """The rotation from the camera to the frame, a unit quaternion, w first."""

    @field_validator("orientation_wxyz")
    @classmethod
    def _unit(cls, value: Quaternion) -> Quaternion:
        length = math.hypot(*value)
        if abs(length - 1.0) > _UNIT_TOLERANCE:
            raise ValueError(f"a unit quaternion, w first; the length of this one is {length:.4g}")
        return value

    @classmethod
    def looking_at(
        cls,
        position: Vector,
        target: Vector,
        up: Vector = (0.0, 0.0, 1.0),
        frame: Literal["world", "model"] = "world",
    ) -> Self:
        """Pose of a camera at ``position`` that looks at ``target``, with ``up`` upwards in its image.

        Raises ``ValueError`` when the two coincide, or the camera would look along ``up``.
        """
        forward = _unit_vector(_minus(target, position))
        right = _unit_vector(_cross(forward, up))
        down = _cross(forward, right)
        return cls(frame=frame, position=position, orientation_wxyz=_quaternion(right, down, forward))


class VehiclePose(Input):
    """A camera's pose from a vehicle: yaw clockwise from north, pitch up, roll with the right side down."""

    latitude_deg: Latitude
    """Geodetic latitude on WGS 84, north positive."""
    longitude_deg: Longitude
    """Longitude, east positive."""
    altitude_m: Altitude
    """Altitude above `altitude_datum`."""
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL
    """What the altitude is measured from; that of the scene."""
    yaw_deg: Yaw
    """The camera's heading, clockwise from north."""
    pitch_deg: Tilt
    """Up is positive: -90 looks straight down."""
    roll_deg: Tilt = 0.0
    """Positive with the right side down."""


def _kind_of_pose(value: Any) -> str:
    geodetic = isinstance(value, VehiclePose) or (isinstance(value, Mapping) and "latitude_deg" in value)
    return "vehicle" if geodetic else "frame"


Pose = Annotated[
    Annotated[FramePose, Tag("frame")] | Annotated[VehiclePose, Tag("vehicle")], Discriminator(_kind_of_pose)
]


PoseFrame = Literal["world", "model", "geodetic"]
"""In which frame a pose is given; geodetic is a ``VehiclePose``, the others are a ``FramePose``."""


def frame_of(pose: FramePose | VehiclePose) -> PoseFrame:
    """The frame in which a pose is given."""
    return "geodetic" if isinstance(pose, VehiclePose) else pose.frame


def _minus(a: Vector, b: Vector) -> Vector:
    return (a[0] - b[0], a[1] - b[1], a[2] - b[2])


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])


def _unit_vector(vector: Vector) -> Vector:
    length = math.hypot(*vector)
    if length < 1e-12:
        raise ValueError("the camera is at its target, or looks along `up`")
    return (vector[0] / length, vector[1] / length, vector[2] / length)


def _quaternion(x: Vector, y: Vector, z: Vector) -> Quaternion:
    """Quaternion of the rotation with columns ``x``, ``y``, ``z``, by its largest part for stability."""
    squares = (
        1.0 + x[0] + y[1] + z[2],
        1.0 + x[0] - y[1] - z[2],
        1.0 - x[0] + y[1] - z[2],
        1.0 - x[0] - y[1] + z[2],
    )
    largest = max(range(4), key=squares.__getitem__)
    products = {
        (0, 1): y[2] - z[1],
        (0, 2): z[0] - x[2],
        (0, 3): x[1] - y[0],
        (1, 2): x[1] + y[0],
        (1, 3): z[0] + x[2],
        (2, 3): y[2] + z[1],
    }
    parts = [
        squares[index] if index == largest else products[min(index, largest), max(index, largest)]
        for index in range(4)
    ]
    length = math.hypot(*parts)
    sign = -1.0 if parts[0] < 0 else 1.0
    w, i, j, k = (sign * part / length for part in parts)
    return (w, i, j, k)
