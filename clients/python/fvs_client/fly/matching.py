"""Which photograph belongs to which trigger of a flight: the one place that decides it."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from fvs_client import Candidate
from fvs_client.fly.captures import Capture, Source
from fvs_client.fly.items import Frame, MissionItem

_SAME_M = 1.0
"""Triggers whose distance from a photograph differs by less are distinguished by time."""
_DEGREE_M = 111_195.0


@dataclass(eq=False)
class Shot:
    """A trigger of a mission, and what is known of its photograph."""

    item: int
    """The trigger's number in the mission."""
    place: MissionItem
    view: Candidate | None = None
    reached_s: float = math.inf
    """When the mission was first seen at it, on the monotonic clock; infinite before."""
    reports: dict[Source, Capture] = field(default_factory=dict)
    """The newest report of each source."""
    over: bool = False
    """Whether its leg has ended: nobody waits for it any more."""

    @property
    def arrived(self) -> bool:
        """Whether its file has come into the folder, and the service has not refused it."""
        return any(source.is_folder and report.succeeded for source, report in self.reports.items())

    @property
    def failed(self) -> bool:
        """Whether it has no photograph: the camera or the service says so, or nothing came in time."""
        return not self.arrived and (self.over or any(not report.succeeded for report in self._all))

    @property
    def reported(self) -> bool:
        """Whether anything is known of its photograph."""
        return bool(self.reports)

    @property
    def said(self) -> Capture | None:
        """What the camera says of it, with the position where it was taken, or else the file's."""
        return min(
            self._all, key=lambda report: (report.source.is_folder, report.place is None), default=None
        )

    @property
    def _all(self) -> Sequence[Capture]:
        return tuple(self.reports.values())


def shot_of(capture: Capture, shots: Sequence[Shot]) -> Shot | None:
    """The trigger that a report belongs to, of all of a flight in their order; None for no trigger of it.

    Autopilot, camera and folder each report a photograph, in any order, late or never, and with clocks of
    their own. So each source is assigned by itself, and a trigger has at most one photograph of each.

    1. The file's name. A report with the name of a file that is known belongs to the same trigger.
    2. The mission. A photograph is never of a trigger that the mission has not reached. This is the only use
       of our clock.
    3. The order. Each source numbers its photographs. One belongs after those with lower numbers and before
       those with higher ones, with as many triggers between them as numbers. This wins over all below.
    4. The position. The nearest triggers: vehicle, camera and mission have it from the same receiver.
    5. A leg that goes on wins over one that is over.
    6. The time. The source's clock since its photograph before, against the time between the triggers.
    7. The first.

    What would exclude every trigger, as a number after a restart does in 3, is ignored.
    """
    if capture.file:
        for shot in reversed(shots):
            if any(report.file == capture.file for report in shot.reports.values()):
                return shot
    open_ = [
        n for n, shot in enumerate(shots) if shot.reached_s < math.inf and capture.source not in shot.reports
    ]
    if not open_:
        return None
    known = [
        (n, shot.reports[capture.source]) for n, shot in enumerate(shots) if capture.source in shot.reports
    ]
    open_ = _only(open_, lambda n: all(_in_order(capture, n, other, at) for at, other in known))
    if capture.place is not None:
        away_m = {n: _distance_m(capture, shots[n].place) for n in open_}
        nearest_m = min(away_m.values())
        open_ = _only(open_, lambda n: away_m[n] <= nearest_m + _SAME_M)
    open_ = _only(open_, lambda n: not shots[n].over)
    earlier = next((one for one in reversed(known) if one[1].number < capture.number), None)
    if earlier is None or capture.time_s is None or earlier[1].time_s is None:
        return shots[open_[0]]
    since_s = shots[earlier[0]].reached_s + capture.time_s - earlier[1].time_s
    return shots[min(open_, key=lambda n: abs(shots[n].reached_s - since_s))]


def _only(numbers: list[int], holds: Callable[[int], bool]) -> list[int]:
    return [number for number in numbers if holds(number)] or numbers


def _in_order(capture: Capture, at: int, other: Capture, other_at: int) -> bool:
    """Whether a photograph at trigger ``at`` is in order with another of its source."""
    numbers, triggers = capture.number - other.number, at - other_at
    return triggers >= numbers if numbers > 0 else triggers <= numbers


def _distance_m(capture: Capture, item: MissionItem) -> float:
    assert capture.place is not None
    north_m = (capture.place[0] - item.x) * _DEGREE_M
    degrees = (capture.place[1] - item.y + 180.0) % 360.0 - 180.0
    east_m = degrees * _DEGREE_M * math.cos(math.radians(item.x))
    up_m = (capture.height_m if item.frame == Frame.RELATIVE else capture.altitude_m) - item.z
    return math.hypot(north_m, east_m, 0.0 if math.isnan(up_m) else up_m)
