"""Differences of autopilots: the flight modes and missions of ArduPilot's copters and of PX4.

https://ardupilot.org/copter/docs/flight-modes.html; PX4's modes are ``main << 16 | sub << 24``
(``px4_custom_mode.h``).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import Enum, auto

from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import Command
from fvs_schema.missions import Autopilot

_ARDUPILOT, _PX4 = 3, 12
"""``MAV_AUTOPILOT``."""
_COPTERS = frozenset({2, 3, 4, 13, 14, 15, 29, 35})
"""``MAV_TYPE``: quadrotor, coaxial, helicopter, and those with 6, 8, 3, 12 and 10 rotors."""


class Mode(Enum):
    """Flight modes."""

    MISSION = auto()
    PAUSE = auto()
    """It stops at once."""
    HOLD = auto()
    """It arms in this mode. Where that is the mode of a pause, it is reported as ``PAUSE``."""
    RETURN = auto()
    LAND = auto()
    OTHER = auto()
    """A pilot flies it, or something else."""


@dataclass(frozen=True)
class Dialect:
    """The expectations of one firmware."""

    autopilot: Autopilot
    """The autopilot that the service writes missions for."""
    modes: Mapping[Mode, tuple[int, int]]
    """The numbers of modes in ``MAV_CMD_DO_SET_MODE``: the mode, and the one below it."""
    has_sub_modes: bool
    home_is_first: bool
    """Whether the first item of a mission is home; else missions are sent without it."""
    turns_at_waypoints: bool
    """Whether it turns to the yaw of a waypoint; else that takes ``MAV_CMD_CONDITION_YAW``."""
    replaces_items: bool
    """Whether an upload replaces the items one by one, while the vehicle goes on with the list as it is; else
    it replaces all at its end, and the new mission begins at once."""
    holds_s: float
    """How long its failsafe may hold, in the mode of a pause, before it returns or lands."""
    keeps: Mapping[int, tuple[int, ...]]
    """The parameters, from 0, that it keeps of an item's command; all of those that are not here."""
    also: Mapping[int, Mode] = field(default_factory=dict)
    """Other values of ``custom_mode`` that vehicles report, but that are never requested."""

    @property
    def not_sent(self) -> int:
        """Number of items at the start of a mission (home) that are not sent to the autopilot."""
        return 0 if self.home_is_first else 1

    def reported(self, mode: Mode) -> Mode:
        """The mode that it reports in a mode that is requested: two may be one for it."""
        return self.mode_of(self.custom_mode(mode))

    def custom_mode(self, mode: Mode) -> int:
        """The ``custom_mode`` of a mode in heartbeats."""
        main, sub = self.modes[mode]
        return main << 16 | sub << 24 if self.has_sub_modes else main

    def mode_of(self, custom_mode: int) -> Mode:
        """The mode of a heartbeat."""
        for mode in self.modes:
            if custom_mode == self.custom_mode(mode):
                return mode
        return self.also.get(custom_mode, Mode.OTHER)


ARDUPILOT = Dialect(
    Autopilot.ARDUPILOT,
    {
        Mode.MISSION: (3, 0),  # AUTO
        Mode.PAUSE: (4, 0),  # GUIDED: in BRAKE no failsafe for ground stations acts, by FS_OPTIONS's default
        Mode.HOLD: (4, 0),  # GUIDED
        Mode.RETURN: (6, 0),  # RTL
        Mode.LAND: (9, 0),
    },
    has_sub_modes=False,
    home_is_first=True,
    turns_at_waypoints=False,
    replaces_items=True,
    holds_s=0.0,
    # Its acceptance radius is WPNAV_RADIUS, and loiters have none.
    keeps={
        Command.WAYPOINT: (0,),
        Command.LOITER_TIME: (0,),
        Command.TAKEOFF: (),
        Command.MOUNT_CONTROL: (0, 1, 2),
    },
    also={21: Mode.RETURN, 27: Mode.RETURN},  # SMART_RTL, AUTO_RTL
)
_AUTO = 4
PX4 = Dialect(
    Autopilot.PX4,
    {
        Mode.MISSION: (_AUTO, 4),
        Mode.PAUSE: (_AUTO, 3),  # AUTO.LOITER
        Mode.HOLD: (_AUTO, 3),
        Mode.RETURN: (_AUTO, 5),
        Mode.LAND: (_AUTO, 6),
    },
    has_sub_modes=True,
    home_is_first=False,
    turns_at_waypoints=True,
    replaces_items=False,
    holds_s=30.0,  # COM_FAIL_ACT_T is 25 s at most
    keeps={Command.WAYPOINT: (0, 1, 3), Command.LOITER_TIME: (0,), Command.TAKEOFF: (3,)},
    also={_AUTO << 16 | 9 << 24: Mode.LAND},  # AUTO.PRECLAND
)


def dialect_of(autopilot: int, kind: int) -> Dialect:
    """The dialect of a heartbeat's ``autopilot`` and ``type``; raises ``VehicleError`` for unknown ones."""
    known = {_ARDUPILOT: ARDUPILOT, _PX4: PX4}.get(autopilot)
    if known is None:
        raise VehicleError(
            f"The vehicle's firmware is not known (MAV_AUTOPILOT {autopilot}).",
            hint="ArduPilot and PX4 are. For others, write a mission: `fvs-client mission`.",
        )
    if kind not in _COPTERS:
        raise VehicleError(
            f"The vehicle is no copter (MAV_TYPE {kind}).",
            hint="It could not stand still at a view. Check --system, if several vehicles are on the link.",
        )
    return known
