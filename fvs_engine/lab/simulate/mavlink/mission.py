"""The items of missions, fences and rally points: what they are, and how ArduPilot keeps them."""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.vehicle import Array

TYPES = {
    mavlink.MAV_CMD_NAV_WAYPOINT: "WP",
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: "LoitUnlim",
    mavlink.MAV_CMD_NAV_LOITER_TIME: "LoitTime",
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: "RTL",
    mavlink.MAV_CMD_NAV_LAND: "Land",
    mavlink.MAV_CMD_NAV_TAKEOFF: "Takeoff",
    mavlink.MAV_CMD_NAV_DELAY: "Delay",
    mavlink.MAV_CMD_CONDITION_YAW: "CondYaw",
    mavlink.MAV_CMD_DO_CHANGE_SPEED: "ChangeSpeed",
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: "MountControl",
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: "GimbalPitchYaw",
    mavlink.MAV_CMD_IMAGE_START_CAPTURE: "ImageStartCapture",
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: "ImageStopCapture",
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL: "DigiCamCtrl",
    mavlink.MAV_CMD_DO_SET_ROI: "SetROI",
    mavlink.MAV_CMD_DO_SET_ROI_NONE: "SetROI",
    mavlink.MAV_CMD_DO_FENCE_ENABLE: "FenceEnable",
}
"""Commands that it knows in missions, and ArduPilot's words for them."""
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
"""Commands that take time; the others are done when they are begun, except a turn."""
UNREPORTED = frozenset(
    {
        mavlink.MAV_CMD_DO_DIGICAM_CONTROL,
        mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW,
        mavlink.MAV_CMD_IMAGE_START_CAPTURE,
        mavlink.MAV_CMD_IMAGE_STOP_CAPTURE,
    }
)
"""Commands of ArduPilot's cameras and mounts, without ``MISSION_ITEM_REACHED``."""
PLACED = frozenset(
    {
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LOITER_TIME,
        mavlink.MAV_CMD_NAV_TAKEOFF,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_DO_SET_ROI,
    }
)
_KEPT = {
    mavlink.MAV_CMD_NAV_WAYPOINT: (0,),
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: (2,),
    mavlink.MAV_CMD_NAV_LOITER_TIME: (0,),
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: (),
    mavlink.MAV_CMD_NAV_LAND: (0,),
    mavlink.MAV_CMD_NAV_TAKEOFF: (0,),
    mavlink.MAV_CMD_DO_CHANGE_SPEED: (0, 1, 2),
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: (0, 1, 2),
    mavlink.MAV_CMD_DO_SET_ROI: (0,),
    mavlink.MAV_CMD_DO_SET_ROI_NONE: (),
    mavlink.MAV_CMD_DO_FENCE_ENABLE: (0,),
    mavlink.MAV_CMD_IMAGE_STOP_CAPTURE: (0,),
}
"""The parameters that ArduPilot stores; of other commands it stores all."""
_MAY_BE_UNKNOWN = frozenset(
    {
        mavlink.MAV_CMD_NAV_WAYPOINT,
        mavlink.MAV_CMD_NAV_LOITER_UNLIM,
        mavlink.MAV_CMD_NAV_LAND,
        mavlink.MAV_CMD_NAV_TAKEOFF,
    }
)
"""Commands whose yaw may be NaN."""
_INVALID = (
    mavlink.MAV_MISSION_INVALID_PARAM1,
    mavlink.MAV_MISSION_INVALID_PARAM2,
    mavlink.MAV_MISSION_INVALID_PARAM3,
    mavlink.MAV_MISSION_INVALID_PARAM4,
)
_ABOVE_SEA = frozenset({mavlink.MAV_FRAME_GLOBAL, mavlink.MAV_FRAME_GLOBAL_INT})
_ABOVE_HOME = frozenset({mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT})
_LARGEST_ALTITUDE_M = 83_000.0
_WHOLE = frozenset({mavlink.MAV_CMD_DO_DIGICAM_CONTROL, mavlink.MAV_CMD_NAV_DELAY})
"""Commands without a place whose parameters ArduPilot stores as whole numbers."""
_NOT_PLACED: Mapping[int, Callable[["Item"], tuple[int, int, float]]] = {
    mavlink.MAV_CMD_DO_DIGICAM_CONTROL: lambda item: (item.x, item.y, 0.0),
    mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW: lambda item: (item.x, 0, item.z),
    mavlink.MAV_CMD_DO_MOUNT_CONTROL: lambda _item: (0, 0, float(mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING)),
}
"""The ``x``, ``y`` and ``z`` that ArduPilot returns for commands without a place."""


def _nowhere(_item: "Item") -> tuple[int, int, float]:
    return 0, 0, 0.0


@dataclass(frozen=True)
class Item:
    """One item as it was received; ``x`` and ``y`` are degrees times 1e7 where it has a place."""

    command: int
    frame: int
    parameters: tuple[float, float, float, float]
    x: int
    y: int
    z: float

    @classmethod
    def of(cls, message: Any) -> "Item":
        """The item in a ``MISSION_ITEM_INT``, or in a ``MISSION_ITEM``; its ``x`` and ``y`` are 0 if NaN."""
        parameters = (message.param1, message.param2, message.param3, message.param4)
        x, y = message.x, message.y
        if message.get_type() == "MISSION_ITEM":
            factor = 1e7 if message.command in PLACED | FENCE | RALLY else 1.0
            x, y = (round(each * factor) if math.isfinite(each) else 0 for each in (x, y))
        return cls(message.command, message.frame, parameters, x, y, message.z)

    @property
    def degrees(self) -> tuple[float, float]:
        """Latitude and longitude."""
        return self.x * 1e-7, self.y * 1e-7

    @property
    def refusal(self) -> int | None:
        """``MAV_MISSION_RESULT`` for an item that cannot be flown; None for others."""
        if self.command not in TYPES:
            return int(mavlink.MAV_MISSION_UNSUPPORTED)
        for number, value in enumerate(self.parameters):
            unknown = math.isnan(value) and number == 3 and self.command in _MAY_BE_UNKNOWN
            if not math.isfinite(value) and not unknown:
                return int(_INVALID[number])
        return self._place_refusal if self.command in PLACED else None

    @property
    def _place_refusal(self) -> int | None:
        if abs(self.x) > 90e7:
            return int(mavlink.MAV_MISSION_INVALID_PARAM5_X)
        if abs(self.y) > 180e7:
            return int(mavlink.MAV_MISSION_INVALID_PARAM6_Y)
        if not abs(self.z) < _LARGEST_ALTITUDE_M:
            return int(mavlink.MAV_MISSION_INVALID_PARAM7)
        if self.frame not in _ABOVE_SEA | _ABOVE_HOME:
            return int(mavlink.MAV_MISSION_UNSUPPORTED_FRAME)
        return None

    @property
    def kept(self) -> "Item":
        """The item as ArduPilot stores it, which is how it is read back."""
        kept = _KEPT.get(self.command, (0, 1, 2, 3))
        values = [float(value) if number in kept else 0.0 for number, value in enumerate(self.parameters)]
        if self.command not in PLACED:
            if self.command in _WHOLE:
                values = [float(int(value)) for value in values]
            first, second, third, fourth = values
            x, y, z = _NOT_PLACED.get(self.command, _nowhere)(self)
            return replace(self, frame=0, parameters=(first, second, third, fourth), x=x, y=y, z=z)
        first, second, third, fourth = (float(int(value)) for value in values)
        if (
            self.command == mavlink.MAV_CMD_NAV_LOITER_TIME
        ):  # its direction, and whether it leaves by a tangent
            third, fourth = math.copysign(1.0, self.parameters[2]), float(self.parameters[3] > 0.0)
        if self.command == mavlink.MAV_CMD_NAV_LAND:
            fourth = -1.0 if self.parameters[3] < 0.0 else 1.0
        frame = mavlink.MAV_FRAME_GLOBAL
        if self.frame in _ABOVE_HOME:
            frame = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT
        centimetres = int(float(np.float32(self.z) * np.float32(100.0)))
        return replace(
            self, frame=int(frame), parameters=(first, second, third, fourth), z=centimetres * 0.01
        )

    def position(self, origin: GeodeticPosition, home_height_m: float, here: Array) -> Array:
        """The item's position [3]; zeros mean ``here``, as in ArduPilot."""
        above_m = self.z + home_height_m if self.frame in _ABOVE_HOME else self.z - origin.altitude_m
        if not math.isfinite(above_m):
            above_m = float(here[2])
        if self.x == 0 and self.y == 0:
            return np.array([here[0], here[1], above_m])
        place = enu_from_geodetic(GeodeticPosition(*self.degrees, origin.altitude_m), origin)
        return np.array([place[0], place[1], above_m])


FENCE = frozenset(
    {
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION,
        mavlink.MAV_CMD_NAV_FENCE_RETURN_POINT,
    }
)
RALLY = frozenset({mavlink.MAV_CMD_NAV_RALLY_POINT})
