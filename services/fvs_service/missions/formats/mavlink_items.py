"""Missions as MAVLink commands, for autopilots with ArduPilot or PX4.

The numbers are those of ``common.xml``: https://mavlink.io/en/messages/common.html.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

from fvs_schema.missions import Autopilot, Finish
from fvs_schema.scenes import AltitudeDatum
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.flight import Mission, Waypoint
from fvs_service.missions.times import AFTER_PHOTOGRAPH_S, SETTLE_S, TURN_S

DATUMS = frozenset({AltitudeDatum.TAKEOFF, AltitudeDatum.SEA_LEVEL})
_MOST_ITEMS = 65_535
"""``MISSION_COUNT`` has 16 bits."""
_TARGETING = 2.0
"""``MAV_MOUNT_MODE_MAVLINK_TARGETING``."""
_GROUND_SPEED = 1.0
_KEEP_THROTTLE = -1.0


class Frame(IntEnum):
    """``MAV_FRAME``: the frame of a command's coordinates."""

    GLOBAL = 0
    MISSION = 2
    GLOBAL_RELATIVE_ALT = 3
    GLOBAL_TERRAIN_ALT = 10


class Command(IntEnum):
    """``MAV_CMD``."""

    NAV_WAYPOINT = 16
    NAV_RETURN_TO_LAUNCH = 20
    NAV_TAKEOFF = 22
    NAV_DELAY = 93
    CONDITION_YAW = 115
    DO_CHANGE_SPEED = 178
    DO_DIGICAM_CONTROL = 203
    DO_MOUNT_CONTROL = 205
    IMAGE_START_CAPTURE = 2000


@dataclass(frozen=True)
class Item:
    """A command with its seven parameters; the last three are latitude, longitude and altitude, if any.

    NaN is a parameter that the autopilot chooses.
    """

    command: Command
    frame: Frame
    parameters: tuple[float, float, float, float, float, float, float]

    @property
    def placed(self) -> bool:
        """Whether the last parameters are a position."""
        return self.frame is not Frame.MISSION


def items_of(mission: Mission) -> tuple[Item, ...]:
    """The commands of a mission; raises ``InvalidRequestError`` for more than MAVLink can count."""
    items = tuple(_items(mission))
    if len(items) > _MOST_ITEMS:
        raise InvalidRequestError(
            f"The mission has {len(items)} MAVLink items; {_MOST_ITEMS} are possible.",
            hint="Ask for fewer views.",
        )
    return items


def frame_of(mission: Mission) -> Frame:
    """The frame of waypoints' altitudes for an autopilot."""
    return Frame.GLOBAL_TERRAIN_ALT if mission.options.above_ground else _frame_of_datum(mission)


def _frame_of_datum(mission: Mission) -> Frame:
    return Frame.GLOBAL_RELATIVE_ALT if mission.datum is AltitudeDatum.TAKEOFF else Frame.GLOBAL


def _items(mission: Mission) -> Iterator[Item]:
    options = mission.options
    px4 = options.autopilot is Autopilot.PX4
    if mission.home is not None and mission.climb_m is not None:
        place = (mission.home.latitude_deg, mission.home.longitude_deg, mission.climb_m)
        yaw = math.nan if px4 else 0.0  # ArduPilot ignores it, and old ground stations cannot read NaN
        yield Item(Command.NAV_TAKEOFF, _frame_of_datum(mission), (0.0, 0.0, 0.0, yaw, *place))
    yield _command(Command.DO_CHANGE_SPEED, _GROUND_SPEED, options.speed_m_s, _KEEP_THROTTLE)
    photographs = 0
    for waypoint in mission.waypoints:
        if waypoint.name is None:
            yield _waypoint(mission, waypoint)
            continue
        photographs += 1
        # The gimbal turns on the way. What comes after a waypoint is done once it is reached.
        yield _command(Command.DO_MOUNT_CONTROL, waypoint.pitch_deg, last=_TARGETING)
        yield _waypoint(mission, waypoint)
        if px4:
            # It turns to the waypoint's yaw, and counts its hold meanwhile: a delay begins after it.
            yield _delay(max(SETTLE_S, options.hold_s))
            yield _command(Command.IMAGE_START_CAPTURE, 0.0, 0.0, 1.0, float(photographs))
        else:
            # It ignores a yaw of waypoints. It turns beside the next NAV command, the delay, and at its end
            # drops what has not begun: a photograph in the same delay would be lost by a long turn.
            yield _command(Command.CONDITION_YAW, waypoint.yaw_deg)
            yield _delay(TURN_S + options.hold_s)
            yield _command(Command.DO_DIGICAM_CONTROL, fifth=1.0)
        yield _delay(AFTER_PHOTOGRAPH_S)
    if options.finish is Finish.RETURN:
        yield _command(Command.NAV_RETURN_TO_LAUNCH)


def _waypoint(mission: Mission, waypoint: Waypoint) -> Item:
    frame, altitude_m = frame_of(mission), waypoint.altitude_m
    if frame is Frame.GLOBAL_TERRAIN_ALT:
        assert waypoint.above_ground_m is not None, "waypoints without terrain were refused"
        altitude_m = waypoint.above_ground_m
    place = (waypoint.latitude_deg, waypoint.longitude_deg, altitude_m)
    return Item(
        Command.NAV_WAYPOINT,
        frame,
        (0.0, mission.options.acceptance_radius_m, 0.0, waypoint.yaw_deg, *place),
    )


def _delay(seconds: float) -> Item:
    return _command(Command.NAV_DELAY, seconds, -1.0, -1.0, -1.0)  # -1: not until a time of the day


def _command(
    command: Command,
    first: float = 0.0,
    second: float = 0.0,
    third: float = 0.0,
    fourth: float = 0.0,
    *,
    fifth: float = 0.0,
    last: float = 0.0,
) -> Item:
    return Item(command, Frame.MISSION, (first, second, third, fourth, fifth, 0.0, last))
