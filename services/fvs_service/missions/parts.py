"""Flights cut into parts that a battery lasts for."""

from collections.abc import Sequence

import numpy as np
import pymap3d

from fvs_service.missions.flight import Waypoint


def length_m(way: Sequence[Waypoint]) -> float:
    """The length of a straight way through waypoints, in three dimensions."""
    places = np.array([(point.latitude_deg, point.longitude_deg, point.altitude_m) for point in way])
    steps = np.diff(np.stack(pymap3d.geodetic2ecef(*places.T)), axis=1)
    return float(np.linalg.norm(steps, axis=0).sum())


def fewest_parts(
    away_m: Sequence[float], between_m: Sequence[float], back_m: Sequence[float], longest_m: float
) -> tuple[range, ...] | None:
    """As few runs of consecutive views as possible, none longer than ``longest_m``; None if there are none.

    ``away_m[i]`` and ``back_m[i]`` are the ways from home to view ``i`` and back, infinite where they cannot
    be flown; ``between_m[i]`` is the way to it from the view before. Of equally many parts the first are the
    longest: as of a vehicle that turns back as late as it can. That is optimal where no detour is shorter
    than the straight way; with a fence or a terrain it need not be, so all cuts are compared, from the last
    view to the first.
    """
    count = len(away_m)
    flown_m, back = np.cumsum(between_m), np.asarray(back_m)
    needed = np.full(count + 1, np.inf)
    needed[count] = 0
    end = np.zeros(count, dtype=int)
    for first in reversed(range(count)):
        lengths_m = away_m[first] + flown_m[first:] - flown_m[first] + back[first:]
        parts = np.where(lengths_m <= longest_m, 1 + needed[first + 1 :], np.inf)
        last = count - 1 - int(np.argmin(parts[::-1]))
        needed[first], end[first] = parts[last - first], last + 1
    if not np.isfinite(needed[0]):
        return None
    found, first = [], 0
    while first < count:
        found.append(range(first, int(end[first])))
        first = int(end[first])
    return tuple(found)
