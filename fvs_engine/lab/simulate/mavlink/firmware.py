"""Firmwares that a simulated autopilot imitates: the differences of ArduCopter and PX4.

https://ardupilot.org/copter/docs/parameters.html, https://docs.px4.io/main/en/advanced_config/parameter_reference.html;
PX4's modes are ``main << 16 | sub << 24`` (``px4_custom_mode.h``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import Mode

CAPACITY_MAH = 5_000.0


class Meaning(Enum):
    """What a parameter changes."""

    SPEED = auto()
    """Between waypoints, until a mission changes it."""
    RADIUS = auto()
    """Distance from a waypoint at which it counts as reached."""
    RETURN_HEIGHT = auto()
    """Height above home of its return."""
    LOW_BATTERY = auto()
    """The share of the battery at which it returns."""
    EMPTY_BATTERY = auto()
    """The share of the battery at which it lands."""
    CAPACITY = auto()
    """Capacity of the battery, which relates the other parameters to shares; it cannot be changed."""
    LOST_LINK = auto()
    """What happens without ground stations: nothing, which cannot be changed."""


@dataclass(frozen=True)
class Parameter:
    """A parameter: its value at first, least and largest; 1 of it is ``unit`` m, m/s or shares."""

    name: str
    value: float
    least: float
    largest: float
    unit: float = 1.0


@dataclass(frozen=True)
class Firmware:
    """The behaviour of one firmware."""

    autopilot: int
    """``MAV_AUTOPILOT``."""
    version: int
    modes: Mapping[Mode, tuple[str, int, int]]
    """Name, number and sub-number, as in ``MAV_CMD_DO_SET_MODE``; of equal ones the first is reported."""
    has_sub_modes: bool
    home_is_first: bool
    """Whether the first item of a mission is home, and is not flown."""
    turns_at_waypoints: bool
    """Whether it turns to the yaw of a waypoint; else it looks ahead."""
    start_arms: bool
    """Whether ``MAV_CMD_MISSION_START`` arms."""
    unknown: frozenset[int]
    """Commands that others know in missions."""
    parameters: Mapping[Meaning, Parameter]

    def custom_mode(self, mode: Mode) -> int:
        """``custom_mode`` of a heartbeat."""
        _, main, sub = self.modes[mode]
        return main << 16 | sub << 24 if self.has_sub_modes else main

    def mode_of(self, main: int, sub: int) -> Mode | None:
        """The mode with these numbers; None if it has no such mode."""
        for mode, (_, its_main, its_sub) in self.modes.items():
            if main == its_main and (sub == its_sub or not self.has_sub_modes):
                return mode
        return None


def _version(major: int, minor: int) -> int:
    return major << 24 | minor << 16 | int(mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL)


_ARDUCOPTER = Firmware(
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    _version(4, 5),
    {
        Mode.MISSION: ("AUTO", 3, 0),
        Mode.GUIDED: ("GUIDED", 4, 0),
        Mode.LOITER: ("LOITER", 5, 0),
        Mode.RETURN: ("RTL", 6, 0),
        Mode.LAND: ("LAND", 9, 0),
        Mode.BRAKE: ("BRAKE", 17, 0),
    },
    has_sub_modes=False,
    home_is_first=True,
    turns_at_waypoints=False,
    start_arms=False,
    unknown=frozenset(),
    parameters={
        Meaning.RETURN_HEIGHT: Parameter("RTL_ALT", 1_500.0, 30.0, 300_000.0, 0.01),
        Meaning.RADIUS: Parameter("WPNAV_RADIUS", 100.0, 5.0, 1_000.0, 0.01),
        Meaning.SPEED: Parameter("WPNAV_SPEED", 500.0, 10.0, 2_000.0, 0.01),
        Meaning.CAPACITY: Parameter("BATT_CAPACITY", CAPACITY_MAH, CAPACITY_MAH, CAPACITY_MAH),
        Meaning.LOW_BATTERY: Parameter("BATT_LOW_MAH", 750.0, 0.0, CAPACITY_MAH, 1.0 / CAPACITY_MAH),
        Meaning.LOST_LINK: Parameter("FS_GCS_ENABLE", 0.0, 0.0, 0.0),
        Meaning.EMPTY_BATTERY: Parameter("BATT_CRT_MAH", 150.0, 0.0, CAPACITY_MAH, 1.0 / CAPACITY_MAH),
    },
)
_AUTO = 4
_PX4 = Firmware(
    mavlink.MAV_AUTOPILOT_PX4,
    _version(1, 15),
    {
        Mode.LOITER: ("AUTO.LOITER", _AUTO, 3),
        Mode.MISSION: ("AUTO.MISSION", _AUTO, 4),
        Mode.RETURN: ("AUTO.RTL", _AUTO, 5),
        Mode.LAND: ("AUTO.LAND", _AUTO, 6),
        Mode.GUIDED: ("AUTO.LOITER", _AUTO, 3),
        Mode.BRAKE: ("AUTO.LOITER", _AUTO, 3),
    },
    has_sub_modes=True,
    home_is_first=False,
    turns_at_waypoints=True,
    start_arms=True,
    unknown=frozenset({mavlink.MAV_CMD_CONDITION_YAW}),
    parameters={
        Meaning.RETURN_HEIGHT: Parameter("RTL_RETURN_ALT", 15.0, 0.0, 1_000.0),
        Meaning.RADIUS: Parameter("NAV_ACC_RAD", 1.0, 0.05, 200.0),
        Meaning.SPEED: Parameter("MPC_XY_CRUISE", 5.0, 0.1, 20.0),
        Meaning.LOW_BATTERY: Parameter("BAT_CRIT_THR", 0.15, 0.0, 0.9),
        Meaning.LOST_LINK: Parameter("NAV_DLL_ACT", 0.0, 0.0, 0.0),
        Meaning.EMPTY_BATTERY: Parameter("BAT_EMERGEN_THR", 0.03, 0.0, 0.9),
    },
)
FIRMWARES: Mapping[str, Firmware] = {
    "ardupilot": _ARDUCOPTER,
    "px4": _PX4,
}
