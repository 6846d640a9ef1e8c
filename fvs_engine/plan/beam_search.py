"""The way that lowers the mean variance most where each step has a limited reach, by beam search."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.plan.kriging import TargetVariance
from fvs_engine.plan.planner import Admissible, ViewPlan
from fvs_engine.plan.reach import Reach

Array = NDArray[np.float64]

WIDTH = 200
"""Beam width: paths kept at every step; 500 find paths that are 0.1 % better (docs/design/planning.md)."""
_MOST_STEPS = 4_000
"""Maximum steps of all kept ways together: of ways of 100 steps 40 are kept, at a loss of up to 1 %."""
_LEAST_WIDTH = 20
_LEAST_LENGTH = 1e-9


@dataclass(frozen=True)
class _Way:
    views: tuple[int, ...]
    gain: float
    length: float = 0.0


def plan_way(
    variance: TargetVariance,
    count: int,
    admissible: Admissible,
    *,
    centres: Array,
    here: Array,
    reach: Reach,
    distance: float | None = None,
    width: int | None = None,
) -> ViewPlan:
    """Plan ``count`` steps from ``here`` [3], each to a candidate in ``reach`` of the last.

    ``centres`` [n, 3] are those of the candidates. Ways of fewer steps are returned where none continues, or
    where the next step would exceed the rest of the ``distance`` (None: no limit). ``chosen`` is in the order
    of the visit, and ``ends`` holds the end of the best way that begins with each candidate in reach;
    infinite for the others. ``width``: how many ways are kept at every step (None: as many as take a second
    or so).
    """
    width = width or max(_LEAST_WIDTH, min(WIDTH, _MOST_STEPS // max(1, count)))
    neighbours = _Neighbours(centres, reach)
    ends = np.full(len(centres), np.inf)
    best = _Way((), 0.0)
    # With a distance the ways that gain most in so many steps are long, and soon at their end.
    for power in (0.0,) if distance is None else (0.0, 0.5, 1.0):
        ways = [_Way((), 0.0)]
        for _ in range(count):
            steps = []
            for way in ways:
                last = here if not way.views else centres[way.views[-1]]
                near = neighbours.of(here if not way.views else way.views[-1], way.views)
                near = near[admissible(way.views)[near]]
                lengths = way.length + np.linalg.norm(centres[near] - last, axis=1)
                if distance is not None:
                    near, lengths = near[lengths <= distance], lengths[lengths <= distance]
                steps.append((near, way.gain + variance.gains(way.views, near), lengths))
            ways = _best(ways, steps, width, power)
            if not ways:
                break
            best = max(best, *ways, key=lambda way: way.gain)
            # A first step whose ways were all dropped keeps the variance that they had reached.
            for way in ways:
                first = way.views[0]
                ends[first] = min(ends[first], variance.variance - way.gain)
    return ViewPlan(
        best.views,
        tuple(_gains(variance, best.views)),
        variance.variance,
        variance.variance - best.gain,
        ends,
    )


def _best(
    ways: Sequence[_Way],
    steps: Sequence[tuple[NDArray[np.int64], Array, Array]],
    width: int,
    power: float,
) -> list[_Way]:
    """The ``width`` best ways on from each of ``ways`` by ``steps``: candidates, gains and lengths there.

    The best has the highest gain per ``power`` of its length. Of ways through the same views to the same last
    one, the best is enough. Equal ones are ordered by views.
    """
    order_of_views = np.argsort(sorted(range(len(ways)), key=lambda number: ways[number].views))
    parents = np.repeat(np.arange(len(ways)), [len(near) for near, _, _ in steps])
    last, gains, lengths = (np.concatenate(parts) for parts in zip(*steps, strict=True))
    worth = gains if power == 0 else gains / np.maximum(lengths, _LEAST_LENGTH) ** power
    found: dict[tuple[frozenset[int], int], _Way] = {}
    for place in np.lexsort((last, order_of_views[parents], -worth)).tolist():
        longer = (*ways[parents[place]].views, int(last[place]))
        way = _Way(longer, float(gains[place]), float(lengths[place]))
        found.setdefault((frozenset(longer), longer[-1]), way)
        if len(found) == width:
            break
    return list(found.values())


def _gains(variance: TargetVariance, views: Sequence[int]) -> list[float]:
    return [float(variance.gains(views[:place], np.array([index]))[0]) for place, index in enumerate(views)]


class _Neighbours:
    """Candidates in reach of a candidate or place, without those visited on the way."""

    def __init__(self, centres: Array, reach: Reach) -> None:
        self._centres = centres
        self._reach = reach
        self._ordered: dict[int, tuple[NDArray[np.int64], Array]] = {}

    def of(self, place: int | Array, visited: Sequence[int]) -> NDArray[np.int64]:
        """Indices of candidates, the nearest first."""
        order, lengths = self._from(place)
        free = ~np.isin(order, visited)
        if self._reach.radius is not None:
            return order[free & (lengths <= self._reach.radius)]
        return order[free][: self._reach.nearest]

    def _from(self, place: int | Array) -> tuple[NDArray[np.int64], Array]:
        if isinstance(place, int):
            if place not in self._ordered:
                self._ordered[place] = self._sorted(self._centres[place])
            return self._ordered[place]
        return self._sorted(place)

    def _sorted(self, here: Array) -> tuple[NDArray[np.int64], Array]:
        lengths = np.linalg.norm(self._centres - here, axis=1)
        order = np.argsort(lengths, kind="stable")
        return order, lengths[order]
