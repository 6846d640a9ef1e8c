"""Flights cut into parts that a battery lasts for."""

from collections.abc import Sequence

import numpy as np


def fewest_parts(
    away_s: Sequence[float], between_s: Sequence[float], back_s: Sequence[float], longest_s: float
) -> tuple[range, ...] | None:
    """As few runs of consecutive views as possible, none longer than ``longest_s``; None if there are none.

    ``away_s[i]`` and ``back_s[i]`` are the times from home to view ``i`` and back, infinite where the ways
    cannot be flown; ``between_s[i]`` is that to it from the view before. Of equally many parts the first are
    the longest: as of a vehicle that turns back as late as it can. That is optimal where no detour is shorter
    than the straight way; with a fence or a terrain it need not be, so all cuts are compared, from the last
    view to the first.
    """
    count = len(away_s)
    flown_s, back = np.cumsum(between_s), np.asarray(back_s)
    needed = np.full(count + 1, np.inf)
    needed[count] = 0
    end = np.zeros(count, dtype=int)
    for first in reversed(range(count)):
        times_s = away_s[first] + flown_s[first:] - flown_s[first] + back[first:]
        parts = np.where(times_s <= longest_s, 1 + needed[first + 1 :], np.inf)
        last = count - 1 - int(np.argmin(parts[::-1]))
        needed[first], end[first] = parts[last - first], last + 1
    if not np.isfinite(needed[0]):
        return None
    found, first = [], 0
    while first < count:
        found.append(range(first, int(end[first])))
        first = int(end[first])
    return tuple(found)
