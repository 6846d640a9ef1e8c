"""Poses of cameras."""

import math
from typing import Literal, Self

from pydantic import field_validator

from fvs_client.models.base import Input, Quaternion, Vector
from fvs_client.models.scenes import AltitudeDatum

_UNIT_TOLERANCE = 1e-3


class FramePose(Input):
    """Pose of an OpenCV camera (x right, y down, z forward), as frame_from_camera."""

    frame: Literal["world", "model"] = "world"
    position: Vector
    orientation_wxyz: Quaternion

    @field_validator("orientation_wxyz")
    @classmethod
    def _unit(cls, value: Quaternion) -> Quaternion:
        if abs(math.hypot(*value) - 1.0) > _UNIT_TOLERANCE:
            raise ValueError(
                f"a unit quaternion, w first; the length of this one is {math.hypot(*value):.4g}"
            )
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
    """Geodetic pose of a vehicle's camera: yaw clockwise from north, pitch up, roll right side down."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float
    altitude_datum: AltitudeDatum = AltitudeDatum.SEA_LEVEL
    yaw_deg: float
    pitch_deg: float
    roll_deg: float = 0.0


def pose_text(pose: FramePose | VehiclePose) -> str:
    """A pose in a table."""
    if isinstance(pose, VehiclePose):
        return (
            f"{pose.latitude_deg:.6f} {pose.longitude_deg:.6f} {pose.altitude_m:.1f} m, "
            f"yaw {pose.yaw_deg:.0f}° pitch {pose.pitch_deg:.0f}°"
        )
    return " ".join(f"{part:.2f}" for part in pose.position)


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
