"""What a vehicle reports of itself: its state, home, texts and photographs."""

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from fvs_client.fly.captures import Captures
from fvs_client.fly.dialects import Dialect, Mode
from fvs_client.fly.places import Home

_FIX_3D = 3
"""``GPS_FIX_TYPE_3D_FIX``."""
_UNKNOWN_TOTALS = (0, 65_535)
"""Values of ``MISSION_CURRENT.total``: it is not told, or there is no mission."""


@dataclass(frozen=True)
class VehicleState:
    """The state that a vehicle reported last. Altitudes are above sea level, heights above home."""

    latitude_deg: float = math.nan
    longitude_deg: float = math.nan
    altitude_m: float = math.nan
    height_m: float = math.nan
    yaw_deg: float = math.nan
    battery: float | None = None
    """The share of the battery that is left, in [0, 1]; None when the vehicle does not report it."""
    armed: bool = False
    mode: Mode = Mode.OTHER
    custom_mode: int = -1
    """The mode as the firmware numbers it."""
    mode_name: str = ""
    """The mode as the firmware names it."""
    failsafe: bool = False
    """Whether its failsafe acts."""
    item: int = 0
    """The number of the mission item that it is at, in the list that was uploaded, whose first is home."""
    replaced_by: int | None = None
    """Number of items, with home, of another mission than the one that was uploaded; None as far as known."""
    fix: int = 0
    """The kind of its GPS fix, ``GPS_FIX_TYPE``; 0 when it reports none."""
    satellites: int = 0

    @property
    def place(self) -> tuple[float, float]:
        """Its latitude and longitude."""
        return self.latitude_deg, self.longitude_deg

    @property
    def located(self) -> bool:
        """Whether its position is known."""
        return math.isfinite(self.latitude_deg)


class Telemetry:
    """The newest of what a vehicle has reported; whoever uses it holds the lock of its link.

    ``mode_name`` names the mode of a heartbeat; ``ask`` requests the report of a photograph by its number.
    """

    def __init__(
        self, mavlink: Any, dialect: Dialect, mode_name: Callable[[Any], str], ask: Callable[[int], None]
    ) -> None:
        self._mavlink, self._dialect, self._mode_name = mavlink, dialect, mode_name
        self.state = VehicleState()
        self.home: Home | None = None
        self.texts: deque[tuple[float, str]] = deque(maxlen=100)
        """What it said to people, and when, on the monotonic clock."""
        self.warnings: deque[str] = deque(maxlen=100)
        self.captures = Captures(ask)
        self.received: dict[str, Any] = {}
        """The newest answers to requests, by the name of the message or the parameter."""
        self.mission_items: int | None = None
        """Number of items, with home, of the mission that it has got here; None before, and in an upload."""

    def receive(self, message: Any) -> None:
        """Record a message of the vehicle."""
        match message.get_type():
            case "HEARTBEAT":
                self.state = replace(
                    self.state,
                    armed=bool(message.base_mode & self._mavlink.MAV_MODE_FLAG_SAFETY_ARMED),
                    mode=self._dialect.mode_of(message.custom_mode),
                    custom_mode=message.custom_mode,
                    failsafe=message.system_status == self._mavlink.MAV_STATE_CRITICAL,
                    mode_name=self._mode_name(message),
                )
            case "GPS_RAW_INT":
                self.state = replace(self.state, fix=message.fix_type, satellites=message.satellites_visible)
            case "GLOBAL_POSITION_INT" if self._placed and (message.lat or message.lon):
                yaw = math.nan if message.hdg == 65535 else message.hdg / 100.0
                self.state = replace(
                    self.state,
                    latitude_deg=message.lat / 1e7,
                    longitude_deg=message.lon / 1e7,
                    altitude_m=message.alt / 1e3,
                    height_m=message.relative_alt / 1e3,
                    yaw_deg=yaw,
                )
            case "SYS_STATUS":
                left = message.battery_remaining
                self.state = replace(self.state, battery=None if left < 0 else left / 100.0)
            case "MISSION_CURRENT":
                self.state = replace(self.state, item=message.seq + self._dialect.not_sent)
                if self.mission_items is not None and message.total not in _UNKNOWN_TOTALS:
                    count = message.total + 1  # home is not counted
                    self.state = replace(
                        self.state, replaced_by=None if count == self.mission_items else count
                    )
            case "CAMERA_IMAGE_CAPTURED":
                home_m = math.nan if self.home is None else self.home.altitude_m
                self.captures.add(message, home_m)
            case "CAMERA_FEEDBACK":
                self.captures.add_feedback(message)
            case "CAMERA_CAPTURE_STATUS":
                component = message.get_srcComponent()
                self.captures.are(component, message.image_count, message.time_boot_ms)
            case "STATUSTEXT":
                self.texts.append((time.monotonic(), message.text))
                if message.severity <= self._mavlink.MAV_SEVERITY_WARNING:
                    self.warnings.append(message.text)
            case "HOME_POSITION":
                if message.latitude or message.longitude:
                    place = message.latitude / 1e7, message.longitude / 1e7
                    self.home = Home(*place, message.altitude / 1e3)
                    self.received[message.get_type()] = message
            case "PARAM_VALUE":
                self.received[message.param_id] = message
            case "CAMERA_INFORMATION" | "GIMBAL_MANAGER_INFORMATION" | "AUTOPILOT_VERSION" | "WIND":
                self.received[message.get_type()] = message

    def forget_item(self) -> None:
        """Forget the current mission item until the vehicle reports it again."""
        self.state = replace(self.state, item=-1)

    def know_mission(self, count: int | None) -> None:
        """It has a mission of so many items, with home; None while it gets another."""
        self.mission_items, self.state = count, replace(self.state, replaced_by=None)

    def missing(self) -> str:
        """What is missing to know where it is."""
        if self.state.fix < _FIX_3D:
            return f"has no GPS fix yet (GPS_RAW_INT: fix_type {self.state.fix})"
        if not self.state.located:
            return "has no position yet (GLOBAL_POSITION_INT)"
        return "" if self.home is not None else "has no home yet (HOME_POSITION)"

    @property
    def _placed(self) -> bool:
        """Whether it has, or had, a GPS fix: ArduPilot sends zeros before."""
        return self.state.located or self.state.fix >= _FIX_3D
