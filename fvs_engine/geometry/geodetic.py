"""Places on earth and the attitudes of vehicles, as cameras in a local east-north-up frame.

The world frame is ENU in metres: x east, y north, z up, at an origin that never moves. Yaw is clockwise from
north, pitch is up, roll has the right side down; a camera with all three at 0 looks north, level and upright.
"""

from dataclasses import dataclass

import numpy as np
import pymap3d
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.transforms import RigidTransform

Array = NDArray[np.float64]


@dataclass(frozen=True)
class GeodeticPosition:
    """A place on the WGS 84 ellipsoid; ``altitude_m`` is above whatever datum all of a scene's places share.

    Within a scene's extent the difference of two altitudes over the geoid equals that over the ellipsoid to a
    few centimetres per kilometre, so ENU coordinates may be computed from either.
    Raises ``InvalidInputError`` for coordinates that are not on earth or not finite.
    """

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    def __post_init__(self) -> None:
        if not (
            abs(self.latitude_deg) <= 90.0
            and abs(self.longitude_deg) <= 180.0
            and np.isfinite(self.altitude_m)
        ):
            raise InvalidInputError(
                f"{self.latitude_deg}, {self.longitude_deg}, {self.altitude_m} m is no place on earth."
            )


def enu_from_geodetic(place: GeodeticPosition, origin: GeodeticPosition) -> Array:
    """East, north and up in metres [3] of ``place``, seen from ``origin``."""
    return np.array(
        pymap3d.geodetic2enu(
            place.latitude_deg,
            place.longitude_deg,
            place.altitude_m,
            origin.latitude_deg,
            origin.longitude_deg,
            origin.altitude_m,
        ),
        dtype=np.float64,
    )


def geodetic_from_enu(position_m: Array, origin: GeodeticPosition) -> GeodeticPosition:
    """The place at ``position_m`` [3] (east, north, up), seen from ``origin``."""
    latitude, longitude, altitude = pymap3d.enu2geodetic(
        *map(float, position_m), origin.latitude_deg, origin.longitude_deg, origin.altitude_m
    )
    return GeodeticPosition(float(latitude), float(longitude), float(altitude))


def camera_at(position_m: Array, yaw_deg: float, pitch_deg: float, roll_deg: float = 0.0) -> RigidTransform:
    """The world_from_camera of an OpenCV camera at ``position_m`` [3] (ENU) with a vehicle's attitude."""
    yaw, pitch, roll = np.deg2rad([yaw_deg, pitch_deg, roll_deg])
    forward = np.array([np.sin(yaw) * np.cos(pitch), np.cos(yaw) * np.cos(pitch), np.sin(pitch)])
    right = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
    down = np.cross(forward, right)
    level = np.column_stack([right, down, forward])
    # A right side that goes down turns x towards y: a positive turn about the viewing direction.
    turn = np.array([[np.cos(roll), -np.sin(roll), 0.0], [np.sin(roll), np.cos(roll), 0.0], [0.0, 0.0, 1.0]])
    return RigidTransform(level @ turn, position_m)


def attitude_of(world_from_camera: RigidTransform) -> tuple[float, float, float]:
    """Yaw in [0, 360), pitch and roll in degrees of a camera in an ENU frame: the inverse of ``camera_at``.

    Straight up or down, where yaw and roll are one turn, roll is 0.
    """
    rotation = world_from_camera.rotation
    forward, right = rotation[:, 2], rotation[:, 0]
    pitch = np.arctan2(forward[2], np.hypot(forward[0], forward[1]))
    if np.hypot(forward[0], forward[1]) < 1e-9:
        yaw, roll = np.arctan2(-right[1], right[0]), 0.0
    else:
        yaw = np.arctan2(forward[0], forward[1])
        level = np.array([np.cos(yaw), -np.sin(yaw), 0.0])
        roll = np.arctan2(right @ np.cross(forward, level), right @ level)
    return float(np.rad2deg(yaw) % 360.0), float(np.rad2deg(pitch)), float(np.rad2deg(roll))
