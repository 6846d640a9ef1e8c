"""The mission of a simulated autopilot: its items, and what it takes to fly them."""

from dataclasses import dataclass

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.vehicle import Array

NAVIGATION = frozenset(
    {
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_DELAY,
    }
)
"""Commands that take time."""
AT_ONCE = frozenset(
    {
        mavlink.MAV_CMD_CONDITION_YAW,
        mavlink.MAV_CMD_DO_CHANGE_SPEED,
        mavlink.MAV_CMD_DO_MOUNT_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_SET_ROI_NONE,
    }
)
"""Commands that are done when they are given; a turn is waited for."""
PLACED = frozenset(
    {
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LAND,
    }
)
_ABOVE_SEA = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})
_ABOVE_HOME = frozenset({mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_NOWHERE = frozenset({mavlink.MAV_FRAME_MISSION})
_MOST_ITEMS = 700
"""Maximum number of items, as on ArduPilot's boards."""


@dataclass(frozen=True)
class Item:
    """One item as it was received."""

    command: int
    frame: int
    parameters: tuple[float, float, float, float]
    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    @classmethod
    def of(cls, message: mavlink.MAVLink_mission_item_int_message) -> "Item":
        """The item in a ``MISSION_ITEM_INT``."""
        parameters = (message.param1, message.param2, message.param3, message.param4)
        factor = 1.0 if message.frame in _NOWHERE else 1e-7
        return cls(
            message.command, message.frame, parameters, message.x * factor, message.y * factor, message.z
        )

    @property
    def refusal(self) -> int | None:
        """``MAV_MISSION_RESULT`` for an item that cannot be flown; None for others."""
        if self.command not in NAVIGATION | AT_ONCE:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        if self.frame not in _ABOVE_SEA | _ABOVE_HOME | _NOWHERE:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        if self.command in PLACED and abs(self.latitude_deg) > 90.0:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        return None

    def position(self, origin: GeodeticPosition, here: Array) -> Array:
        """The item's position [3]; zeros mean ``here``, as in ArduPilot."""
        if self.frame in _NOWHERE or (self.latitude_deg == 0.0 and self.longitude_deg == 0.0):
            return here.copy()
        above_m = self.altitude_m if self.frame in _ABOVE_HOME else self.altitude_m - origin.altitude_m
        place = GeodeticPosition(self.latitude_deg, self.longitude_deg, origin.altitude_m)
        position = enu_from_geodetic(place, origin)
        return np.array([position[0], position[1], above_m])


class Reception:
    """A mission that a ground station is sending, item by item."""

    def __init__(self, count: int) -> None:
        self.items: list[Item] = []
        self.count = count

    @property
    def refusal(self) -> int | None:
        """``MAV_MISSION_RESULT`` when there are too many."""
        return int(mavlink.MAV_MISSION_NO_SPACE) if self.count > _MOST_ITEMS else None

    @property
    def whole(self) -> bool:
        """Whether all items are here."""
        return len(self.items) == self.count
