"""What a vehicle or camera recorded during a video: pose priors by time."""

from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from datetime import timedelta

from fvs_engine.images.metadata import PhotographPriors

_LONGEST_GAP_S = 3.0
"""Longest time between two records in which the way from one to the other is known; most come once a second
or more often."""
_HOLDS_S = 1.0
"""How long a record alone holds: before the first one, after the last one, and on both sides of a gap."""


@dataclass(frozen=True)
class Record:
    """The priors at ``time_s`` after the beginning of the video.

    ``above_ellipsoid``: the altitude is; that of all other priors is above sea level.
    """

    time_s: float
    priors: PhotographPriors
    above_ellipsoid: bool = False


class Track:
    """Records of a video in the order of their time."""

    def __init__(self, records: Sequence[Record]) -> None:
        self._records = sorted(records, key=lambda record: record.time_s)
        self._times = [record.time_s for record in self._records]
        self.is_above_ellipsoid = any(record.above_ellipsoid for record in self._records)

    def at(self, time_s: float) -> PhotographPriors:
        """The priors at a time, between two records on the way from one to the other; empty far from all."""
        after = bisect_right(self._times, time_s)
        near = self._records[max(after - 1, 0) : after + 1]
        if len(near) == 2 and near[1].time_s - near[0].time_s <= _LONGEST_GAP_S and after > 0:
            return _between(near[0], near[1], time_s)
        nearest = min(near, key=lambda record: abs(record.time_s - time_s), default=None)
        if nearest is None or abs(nearest.time_s - time_s) > _HOLDS_S:
            return PhotographPriors()
        return _moved(nearest, time_s)


def _moved(record: Record, time_s: float) -> PhotographPriors:
    """The priors of a record with the time of day of another moment."""
    taken = record.priors.captured_at
    later = None if taken is None else taken + timedelta(seconds=time_s - record.time_s)
    return replace(record.priors, captured_at=later)


def _between(first: Record, second: Record, time_s: float) -> PhotographPriors:
    share = (time_s - first.time_s) / (second.time_s - first.time_s)
    a, b = first.priors, second.priors
    longitude = _turned(a.longitude_deg, b.longitude_deg, share)
    return PhotographPriors(
        latitude_deg=_mixed(a.latitude_deg, b.latitude_deg, share),
        longitude_deg=longitude,
        altitude_m=_mixed(a.altitude_m, b.altitude_m, share),
        yaw_deg=_turned(a.yaw_deg, b.yaw_deg, share),
        pitch_deg=_mixed(a.pitch_deg, b.pitch_deg, share),
        roll_deg=_turned(a.roll_deg, b.roll_deg, share),
        captured_at=_moved(first, time_s).captured_at,
        height_above_takeoff_m=_mixed(a.height_above_takeoff_m, b.height_above_takeoff_m, share),
    )


def _mixed(first: float | None, second: float | None, share: float) -> float | None:
    return None if first is None or second is None else first + share * (second - first)


def _turned(first: float | None, second: float | None, share: float) -> float | None:
    """Between two angles in degrees, the shorter way round, in [−180, 180)."""
    if first is None or second is None:
        return None
    turn = (second - first + 180.0) % 360.0 - 180.0
    return (first + share * turn + 180.0) % 360.0 - 180.0
