"""Mission items, as in the MAVLink message ``MISSION_ITEM_INT``, and the waypoint files they come from."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum

from fvs_client.fly.errors import VehicleError

_HEADER = "QGC WPL 110"
_FIELDS = 12


class Frame(IntEnum):
    """``MAV_FRAME``: the frame of an item's position."""

    GLOBAL = 0
    """Altitudes above sea level."""
    MISSION = 2
    """No position."""
    RELATIVE = 3
    """Altitudes above home."""


class Plan(IntEnum):
    """``MAV_MISSION_TYPE``: the lists of items that an autopilot has."""

    MISSION = 0
    FENCE = 1


class Command(IntEnum):
    """``MAV_CMD``: those that a flight adds to missions of the service, or knows in them."""

    WAYPOINT = 16
    LOITER_TIME = 19
    RETURN_TO_LAUNCH = 20
    TAKEOFF = 22
    DELAY = 93
    CONDITION_YAW = 115
    DIGICAM_CONTROL = 203
    MOUNT_CONTROL = 205
    IMAGE_START_CAPTURE = 2000
    FENCE_INSIDE = 5001
    """A corner of a polygon to stay inside (``NAV_FENCE_POLYGON_VERTEX_INCLUSION``)."""
    FENCE_OUTSIDE = 5002


PHOTOGRAPHS = frozenset({Command.DIGICAM_CONTROL, Command.IMAGE_START_CAPTURE})
"""Commands that take a photograph."""


@dataclass(frozen=True)
class MissionItem:
    """A command of a mission: four parameters, latitude and longitude in degrees, altitude in m."""

    command: int
    frame: int
    parameters: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)
    x: float = 0.0
    y: float = 0.0
    z: float = 0.0

    @property
    def placed(self) -> bool:
        """Whether ``x`` and ``y`` are a latitude and a longitude."""
        return self.frame != Frame.MISSION

    @property
    def encoded(self) -> tuple[int, int]:
        """``x`` and ``y`` as integers: degrees times 1e7 for positions."""
        factor = 1e7 if self.placed else 1.0
        return tuple(round(0.0 if math.isnan(value) else value * factor) for value in (self.x, self.y))  # type: ignore[return-value]


_RETURN = MissionItem(Command.RETURN_TO_LAUNCH, Frame.MISSION)


def read_waypoints(text: str) -> list[MissionItem]:
    """The items of a file ``QGC WPL 110``, the first of which is home; raises ``VehicleError``."""
    lines = [line for line in text.splitlines() if line.strip()]
    if not lines or lines[0].strip() != _HEADER:
        raise VehicleError(f"This is no mission: its first line is not {_HEADER!r}.")
    items = []
    for number, line in enumerate(lines[1:], start=2):
        fields = line.split()
        try:
            if len(fields) != _FIELDS:
                raise ValueError(f"{len(fields)} fields instead of {_FIELDS}")
            first, second, third, fourth, x, y, z = (float(field) for field in fields[4:11])
            items.append(MissionItem(int(fields[3]), int(fields[2]), (first, second, third, fourth), x, y, z))
        except ValueError as error:
            raise VehicleError(f"Line {number} of the mission cannot be read: {error}.") from error
    return items


def holding(items: Sequence[MissionItem], hold_s: float) -> list[MissionItem]:
    """The mission with ``hold_s`` seconds of waiting at its last waypoint, before it returns home.

    In that time the next mission comes. If none does, the vehicle returns by itself. ArduPilot counts whole
    seconds.
    """
    last = next((item for item in reversed(items) if item.command == Command.WAYPOINT), None)
    if last is None:
        raise VehicleError("The mission has no waypoint.")
    wait = replace(
        last, command=Command.LOITER_TIME, parameters=(float(round(hold_s)), 0.0, 0.0, last.parameters[3])
    )
    ends = items[-1].command == Command.RETURN_TO_LAUNCH
    return [*(items[:-1] if ends else items), wait, _RETURN]


def after(
    items: Sequence[MissionItem], last: Sequence[MissionItem], waits_at: int
) -> tuple[list[MissionItem], int]:
    """A mission for a vehicle that waits at item ``waits_at`` of its ``last``, and the number of its first.

    ArduPilot replaces items one by one, and begins the item that it is at anew when that differs. So this
    item and the return after it stay as they are, before or behind the new ones: a vehicle whose upload ends
    halfway waits, and returns.
    """
    wait = [last[waits_at], _RETURN]
    if len(items) <= waits_at:
        return [*items, *[_RETURN] * (waits_at - len(items)), *wait], 1
    return [items[0], *[_RETURN] * (waits_at - 1), *wait, *items[1:]], waits_at + 2


def resumes_at(items: Sequence[MissionItem], number: int) -> int:
    """The item at which a mission continues after a pause at item ``number``.

    Leaving a mission turns the gimbal back: it turns to the next photograph again, if it did already.
    """
    taken = max((at for at in range(number) if items[at].command in PHOTOGRAPHS), default=0)
    turns = (at for at in range(taken + 1, number) if items[at].command == Command.MOUNT_CONTROL)
    return next(turns, number)
