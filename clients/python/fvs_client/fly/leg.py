"""One leg of a flight: the views of a mission, and which of them was photographed."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from fvs_client import Candidate
from fvs_client.fly.captures import Capture
from fvs_client.fly.items import PHOTOGRAPHS, Command, Frame, MissionItem

_SAME_M = 1.0
"""Views whose distance from a photograph differs by less are distinguished by their order."""
_DEGREE_M = 111_195.0


@dataclass
class Leg:
    """A mission through ``views`` in their order, one photograph at each; a survey has none.

    ``succeeded`` and ``failed`` are the views that the camera has reported.
    """

    items: list[MissionItem]
    views: tuple[Candidate, ...] = ()
    succeeded: list[Candidate] = field(default_factory=list)
    failed: list[Candidate] = field(default_factory=list)
    first: int = 1
    """The number of the item at which it begins, after home."""

    @property
    def count(self) -> int:
        """The number of photographs to take."""
        return sum(item.command in PHOTOGRAPHS for item in self.items)

    @property
    def waits_at(self) -> int:
        """The number of the item at which the vehicle waits for its next mission."""
        return next(
            number
            for number, item in enumerate(self.items)
            if number >= self.first and item.command == Command.LOITER_TIME
        )

    @property
    def left(self) -> tuple[Candidate, ...]:
        """The views without a report."""
        known = {view.id for view in (*self.succeeded, *self.failed)}
        return tuple(view for view in self.views if view.id not in known)

    def take(self, capture: Capture) -> Candidate | None:
        """Assign a photograph to a view: the nearest one that is left, and the first of equals."""
        places = dict(zip((view.id for view in self.views), self._places(), strict=False))
        left = self.left
        if not left:
            return None
        away_m = [_distance_m(capture, places[view.id]) for view in left]
        nearest_m = min(away_m)
        view = next(view for view, away in zip(left, away_m, strict=True) if away <= nearest_m + _SAME_M)
        (self.succeeded if capture.succeeded else self.failed).append(view)
        return view

    def _places(self) -> Sequence[MissionItem]:
        """The position of each photograph."""
        places, last = [], self.items[0]
        for item in self.items:
            if item.command == Command.WAYPOINT:
                last = item
            elif item.command in PHOTOGRAPHS:
                places.append(last)
        return places


def _distance_m(capture: Capture, item: MissionItem) -> float:
    if capture.place is None:
        return 0.0
    north_m = (capture.place[0] - item.x) * _DEGREE_M
    degrees = (capture.place[1] - item.y + 180.0) % 360.0 - 180.0
    east_m = degrees * _DEGREE_M * math.cos(math.radians(item.x))
    up_m = (capture.height_m if item.frame == Frame.RELATIVE else capture.altitude_m) - item.z
    return math.hypot(north_m, east_m, up_m)
