"""Firmwares that a simulated autopilot imitates: the differences of ArduCopter and PX4.

https://ardupilot.org/copter/docs/parameters.html, https://docs.px4.io/main/en/advanced_config/parameter_reference.html;
of PX4 also its sources, such as ``mavlink_mission.cpp``, ``mission_base.cpp`` and ``Commander.cpp``. Its
modes are ``main << 16 | sub << 24`` (``px4_custom_mode.h``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum, auto

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import Mode

CAPACITY_MAH = 5_000.0
_WHOLE_8, _WHOLE_16, _WHOLE_32, _REAL = (
    mavlink.MAV_PARAM_TYPE_INT8,
    mavlink.MAV_PARAM_TYPE_INT16,
    mavlink.MAV_PARAM_TYPE_INT32,
    mavlink.MAV_PARAM_TYPE_REAL32,
)


class Meaning(Enum):
    """What a parameter changes, where both firmwares have one for it."""

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


@dataclass(frozen=True)
class Parameter:
    """A parameter: its value at first and its ``MAV_PARAM_TYPE``; 1 of it is ``unit`` m, m/s or shares."""

    name: str
    value: float
    kind: int = _REAL
    unit: float = 1.0
    fixed: bool = False
    """Whether ground stations cannot change it."""


@dataclass(frozen=True)
class ModeKind:
    """A mode's name, number and sub-number, as in ``MAV_CMD_DO_SET_MODE``."""

    name: str
    main: int
    sub: int = 0
    arms: bool = True
    """Whether the motors can be started in it."""
    needs_position: bool = True


@dataclass(frozen=True)
class Firmware:
    """The behaviour of one firmware."""

    autopilot: int
    """``MAV_AUTOPILOT``."""
    version: int
    first_mode: Mode
    modes: Mapping[Mode, ModeKind]
    """Of those with equal numbers the first is reported."""
    has_sub_modes: bool
    home_is_first: bool
    """Whether the first item of a mission is home, and is not flown."""
    turns_at_waypoints: bool
    """Whether it turns to the yaw of a waypoint; else it looks ahead."""
    unknown: frozenset[int]
    """Commands that others know, in missions and outside of them."""
    only_in_missions: frozenset[int]
    """Commands that it does not know outside of missions."""
    parameters: tuple[Parameter, ...]
    meanings: Mapping[Meaning, str]
    """The parameters with these meanings."""

    @property
    def is_ardupilot(self) -> bool:
        """Whether it is ArduPilot's."""
        return self.autopilot == int(mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)

    def custom_mode(self, mode: Mode) -> int:
        """``custom_mode`` of a heartbeat."""
        kind = self.modes[mode]
        return kind.main << 16 | kind.sub << 24 if self.has_sub_modes else kind.main

    def mode_of(self, main: int, sub: int) -> Mode | None:
        """The mode with these numbers; None if it has no such mode."""
        for mode, kind in self.modes.items():
            if main == kind.main and (sub == kind.sub or not self.has_sub_modes):
                return mode
        return None


def _version(major: int, minor: int) -> int:
    return major << 24 | minor << 16 | int(mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL)


_ARDUCOPTER = Firmware(
    mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA,
    _version(4, 6),
    Mode.STABILIZE,
    {
        Mode.STABILIZE: ModeKind("STABILIZE", 0, needs_position=False),
        Mode.ACRO: ModeKind("ACRO", 1, needs_position=False),
        Mode.ALT_HOLD: ModeKind("ALT_HOLD", 2, needs_position=False),
        Mode.MISSION: ModeKind("AUTO", 3, arms=False),
        Mode.GUIDED: ModeKind("GUIDED", 4),
        Mode.LOITER: ModeKind("LOITER", 5),
        Mode.RETURN: ModeKind("RTL", 6, arms=False),
        Mode.CIRCLE: ModeKind("CIRCLE", 7, arms=False),
        Mode.LAND: ModeKind("LAND", 9, arms=False, needs_position=False),
        Mode.DRIFT: ModeKind("DRIFT", 11),
        Mode.SPORT: ModeKind("SPORT", 13, needs_position=False),
        Mode.POSHOLD: ModeKind("POSHOLD", 16),
        Mode.BRAKE: ModeKind("BRAKE", 17, arms=False),
    },
    has_sub_modes=False,
    home_is_first=True,
    turns_at_waypoints=False,
    unknown=frozenset(),
    only_in_missions=frozenset(),
    parameters=(
        Parameter("ARMING_CHECK", 1.0, _WHOLE_32),
        Parameter("AUTO_OPTIONS", 0.0, _WHOLE_32),
        Parameter("BATT_CAPACITY", CAPACITY_MAH, _WHOLE_32),
        Parameter("BATT_CRT_MAH", 150.0, unit=1.0 / CAPACITY_MAH),
        Parameter("BATT_FS_CRT_ACT", 1.0, _WHOLE_8),
        Parameter("BATT_FS_LOW_ACT", 2.0, _WHOLE_8),
        Parameter("BATT_LOW_MAH", 750.0, unit=1.0 / CAPACITY_MAH),
        Parameter("BATT_MONITOR", 4.0, _WHOLE_8),
        Parameter("CAM1_DURATION", 0.1),
        Parameter("CAM1_TYPE", 6.0, _WHOLE_8),
        Parameter("FENCE_ACTION", 1.0, _WHOLE_8),
        Parameter("FENCE_ALT_MAX", 100.0),
        Parameter("FENCE_ALT_MIN", -10.0),
        Parameter("FENCE_ENABLE", 0.0, _WHOLE_8),
        Parameter("FENCE_MARGIN", 2.0),
        Parameter("FENCE_RADIUS", 300.0),
        Parameter("FENCE_TOTAL", 0.0, _WHOLE_8, fixed=True),
        Parameter("FENCE_TYPE", 7.0, _WHOLE_8),
        Parameter("FS_EKF_ACTION", 1.0, _WHOLE_8),
        Parameter("FS_EKF_THRESH", 0.8),
        Parameter("FS_GCS_ENABLE", 0.0, _WHOLE_8),
        Parameter("FS_GCS_TIMEOUT", 5.0),
        Parameter("FS_OPTIONS", 16.0, _WHOLE_32),
        Parameter("FS_THR_ENABLE", 1.0, _WHOLE_8),
        Parameter("LAND_SPEED", 50.0, _WHOLE_16, 0.01),
        Parameter("MIS_RESTART", 0.0, _WHOLE_8),
        Parameter("MIS_TOTAL", 0.0, _WHOLE_16, fixed=True),
        Parameter("MNT1_TYPE", 1.0, _WHOLE_8),
        Parameter("RTL_ALT", 1_500.0, _WHOLE_32, 0.01),
        Parameter("RTL_CONE_SLOPE", 3.0),
        Parameter("RTL_LOIT_TIME", 5_000.0, _WHOLE_32),
        Parameter("SYSID_MYGCS", 255.0, _WHOLE_16),
        Parameter("SYSID_THISMAV", 1.0, _WHOLE_16),
        Parameter("WPNAV_RADIUS", 100.0, unit=0.01),
        Parameter("WPNAV_SPEED", 500.0, unit=0.01),
        Parameter("WPNAV_SPEED_DN", 150.0, unit=0.01),
        Parameter("WPNAV_SPEED_UP", 250.0, unit=0.01),
    ),
    meanings={
        Meaning.RETURN_HEIGHT: "RTL_ALT",
        Meaning.RADIUS: "WPNAV_RADIUS",
        Meaning.SPEED: "WPNAV_SPEED",
        Meaning.LOW_BATTERY: "BATT_LOW_MAH",
        Meaning.EMPTY_BATTERY: "BATT_CRT_MAH",
    },
)
_AUTO = 4
_PX4 = Firmware(
    mavlink.MAV_AUTOPILOT_PX4,
    _version(1, 15),
    Mode.LOITER,
    {
        Mode.LOITER: ModeKind("AUTO.LOITER", _AUTO, 3),
        Mode.MISSION: ModeKind("AUTO.MISSION", _AUTO, 4),
        Mode.RETURN: ModeKind("AUTO.RTL", _AUTO, 5),
        Mode.LAND: ModeKind("AUTO.LAND", _AUTO, 6),
        Mode.GUIDED: ModeKind("AUTO.LOITER", _AUTO, 3),
        Mode.BRAKE: ModeKind("AUTO.LOITER", _AUTO, 3),
    },
    has_sub_modes=True,
    home_is_first=False,
    turns_at_waypoints=True,
    unknown=frozenset(
        {
            mavlink.MAV_CMD_CONDITION_YAW,
            mavlink.MAV_CMD_DO_FENCE_ENABLE,
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE,
        }
    ),
    only_in_missions=frozenset({mavlink.MAV_CMD_IMAGE_START_CAPTURE, mavlink.MAV_CMD_IMAGE_STOP_CAPTURE}),
    parameters=(
        Parameter("BAT_CRIT_THR", 0.15),
        Parameter("BAT_EMERGEN_THR", 0.03),
        Parameter("COM_DL_LOSS_T", 10.0, _WHOLE_32),
        Parameter("COM_FAIL_ACT_T", 5.0),
        Parameter("COM_LOW_BAT_ACT", 3.0, _WHOLE_32),  # it returns, and lands when it is empty
        Parameter("GF_ACTION", 0.0, _WHOLE_32, fixed=True),
        Parameter("GF_MAX_HOR_DIST", 0.0, fixed=True),
        Parameter("GF_MAX_VER_DIST", 0.0, fixed=True),
        Parameter("MIS_TAKEOFF_ALT", 2.5),
        Parameter("MIS_YAW_ERR", 12.0),
        Parameter("MIS_YAW_TMT", -1.0),
        Parameter("MPC_XY_CRUISE", 5.0),
        Parameter("NAV_ACC_RAD", 1.0),
        Parameter("NAV_DLL_ACT", 0.0, _WHOLE_32),
        Parameter("NAV_RCL_ACT", 2.0, _WHOLE_32, fixed=True),
        Parameter("RTL_RETURN_ALT", 15.0),
        Parameter("SYS_AUTOSTART", 4001.0, _WHOLE_32),
        Parameter("TRIG_INTERFACE", 3.0, _WHOLE_32),
        Parameter("TRIG_MODE", 1.0, _WHOLE_32),
    ),
    meanings={
        Meaning.RETURN_HEIGHT: "RTL_RETURN_ALT",
        Meaning.RADIUS: "NAV_ACC_RAD",
        Meaning.SPEED: "MPC_XY_CRUISE",
        Meaning.LOW_BATTERY: "BAT_CRIT_THR",
        Meaning.EMPTY_BATTERY: "BAT_EMERGEN_THR",
    },
)
FIRMWARES: Mapping[str, Firmware] = {
    "ardupilot": _ARDUCOPTER,
    "px4": _PX4,
}
