"""Conversion of geodetic positions and vehicle attitudes to a local east-north-up frame.

The world frame is ENU in metres: x east, y north, z up, at a fixed origin. Yaw is clockwise from
north, pitch is up, roll has the right side down; a camera with all three at 0 looks north, level and upright.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pymap3d
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.transforms import RigidTransform

Array = NDArray[np.float64]

_VERTICAL = 1e-7
"""Horizontal length of a unit viewing direction below which it is vertical."""


@dataclass(frozen=True)
class GeodeticPosition:
    """A position on the WGS 84 ellipsoid; ``altitude_m`` is above any datum that a scene's positions share.

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
                f"{self.latitude_deg}, {self.longitude_deg}, {self.altitude_m} m is not a position on earth."
            )


def enu_from_geodetic(position: GeodeticPosition, origin: GeodeticPosition) -> Array:
    """East, north and up in metres [3] of ``position``, relative to ``origin``."""
    return np.array(
        pymap3d.geodetic2enu(
            position.latitude_deg,
            position.longitude_deg,
            position.altitude_m,
            origin.latitude_deg,
            origin.longitude_deg,
            origin.altitude_m,
        ),
        dtype=np.float64,
    )


def geodetic_from_enu(position_m: Array, origin: GeodeticPosition) -> GeodeticPosition:
    """The position that is ``position_m`` [3] (east, north, up) from ``origin``; the inverse of the above."""
    return GeodeticPosition(*geodetic_coordinates(position_m[None], origin)[0].tolist())


def geodetic_coordinates(positions_m: Array, origin: GeodeticPosition) -> Array:
    """Latitudes and longitudes in degrees and altitudes in metres [N, 3] of ENU positions [N, 3]."""
    found = pymap3d.enu2geodetic(
        *np.asarray(positions_m, dtype=np.float64).T,
        origin.latitude_deg,
        origin.longitude_deg,
        origin.altitude_m,
    )
    return np.stack(found, axis=1)


def ecef_from_enu(origin: GeodeticPosition) -> RigidTransform:
    """The transform from east, north, up at ``origin`` to the Earth-centred frame of WGS 84, in metres."""
    latitude, longitude = np.deg2rad([origin.latitude_deg, origin.longitude_deg])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    up = np.array(
        [np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude)]
    )
    centre = pymap3d.geodetic2ecef(origin.latitude_deg, origin.longitude_deg, origin.altitude_m)
    return RigidTransform(np.column_stack([east, np.cross(up, east), up]), np.array(centre))


def middle_position(positions: Sequence[GeodeticPosition]) -> GeodeticPosition:
    """The median of positions in each Earth-centred coordinate.

    A few wrong ones do not move it far, and it knows neither an antimeridian nor poles.
    """
    ecef = np.array([pymap3d.geodetic2ecef(*dataclasses.astuple(position)) for position in positions])
    return GeodeticPosition(*map(float, pymap3d.ecef2geodetic(*np.median(ecef, axis=0))))


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
    """Yaw in [0, 360), pitch in [-90, 90] and roll of a camera in degrees; the inverse of ``camera_at``.

    Straight up or down only the difference of yaw and roll has a meaning; the roll is then 0.
    """
    right, _, forward = world_from_camera.rotation.T
    level = float(np.hypot(forward[0], forward[1]))
    pitch_deg = float(np.rad2deg(np.arctan2(forward[2], level)))
    if level < _VERTICAL:
        yaw_deg = float(np.rad2deg(np.arctan2(-right[1], right[0])))
        return yaw_deg % 360.0, float(np.copysign(90.0, forward[2])), 0.0
    yaw_deg = float(np.rad2deg(np.arctan2(forward[0], forward[1])))
    upright = camera_at(world_from_camera.translation, yaw_deg, pitch_deg).rotation
    turned = upright.T @ right
    return yaw_deg % 360.0, pitch_deg, float(np.rad2deg(np.arctan2(turned[1], turned[0])))
