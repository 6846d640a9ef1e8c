"""The set of views that lowers the mean variance of the targets most, planned to the end of the budget.

Greedy choice alone is as good as farthest-point sampling; exchanging views afterwards is what pays.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.plan.kriging import TargetVariance

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

_ROUNDS = 6
"""Exchanges of every view; the third rarely changes anything."""
_LEAST_GAIN = 1e-9
"""Minimum fall of the mean variance by an exchange: less is rounding."""

Admissible = Callable[[Sequence[int]], Mask]
"""Which candidates [n] may join a plan: those that can be registered beside its views, for example."""


@dataclass(frozen=True, eq=False)
class ViewPlan:
    """Planned views, and the variance that they leave.

    ``chosen``: indices of candidates in the order of their gain, the largest first. ``gains``: by how much
    each lowers the mean variance of the targets, in that order. ``variance``: the mean before the plan, and
    ``variance_after``. ``ends`` [n]: the mean at the end if a candidate is visited next, and takes
    the place of the view that is missed least; for planned ones that is ``variance_after``, infinite for what
    may not be visited.
    """

    chosen: tuple[int, ...]
    gains: tuple[float, ...]
    variance: float
    variance_after: float
    ends: Array


def plan_views(variance: TargetVariance, count: int, admissible: Admissible) -> ViewPlan:
    """Choose ``count`` views, or as many as are admissible: greedily, then exchanged one by one.

    Each view is exchanged with the candidate that then lowers the mean variance most, until no exchange
    helps. A view without which another would not be admissible stays.
    """
    chosen = _exchange(variance, _greedy(variance, count, admissible), admissible)
    return _described(variance, chosen, admissible)


def _greedy(variance: TargetVariance, count: int, admissible: Admissible) -> list[int]:
    chosen: list[int] = []
    while len(chosen) < count:
        gains = np.where(_open_to(chosen, admissible), variance.gains(chosen), -np.inf)
        best = int(np.argmax(gains))
        if gains[best] == -np.inf:
            break
        chosen.append(best)
    return chosen


def _exchange(variance: TargetVariance, chosen: list[int], admissible: Admissible) -> list[int]:
    for _ in range(_ROUNDS):
        before = list(chosen)
        for index in before:
            rest = [other for other in chosen if other != index]
            if not stands_alone(rest, admissible):
                continue
            gains = np.where(_open_to(rest, admissible), variance.gains(rest), -np.inf)
            best = int(np.argmax(gains))
            if gains[best] > gains[index] + _LEAST_GAIN:
                chosen = [*rest, best]
        if set(chosen) == set(before):
            break
    return chosen


def _described(variance: TargetVariance, chosen: list[int], admissible: Admissible) -> ViewPlan:
    after = variance.variance_after(chosen)
    ends = np.where(_open_to([], admissible), np.inf, np.nan)
    for index in chosen:
        rest = [other for other in chosen if other != index]
        ends = np.fmin(ends, variance.variance_after(rest) - variance.gains(rest))
    ordered, gains = _by_gain(variance, chosen)
    ends[np.isnan(ends) | ~admissible([])] = np.inf
    ends[[index for index in chosen if np.isfinite(ends[index])]] = after
    return ViewPlan(tuple(ordered), tuple(gains), variance.variance, after, ends)


def _by_gain(variance: TargetVariance, chosen: list[int]) -> tuple[list[int], list[float]]:
    """The views of a plan with their gains: in turn the one that gains most beside those before."""
    ordered: list[int] = []
    gains: list[float] = []
    left = set(chosen)
    while left:
        found = variance.gains(ordered)
        best = max(sorted(left), key=lambda index: float(found[index]))
        ordered.append(best)
        gains.append(float(found[best]))
        left.remove(best)
    return ordered, gains


def _open_to(chosen: Sequence[int], admissible: Admissible) -> Mask:
    """The admissible candidates that are not in the plan yet."""
    mask = admissible(chosen).copy()
    mask[list(chosen)] = False
    return mask


def stands_alone(chosen: Sequence[int], admissible: Admissible) -> bool:
    """Whether all views of the plan are admissible beside one another, in some order."""
    reached: list[int] = []
    left = list(chosen)
    while left:
        mask = admissible(reached)
        ready = [index for index in left if mask[index]]
        if not ready:
            return False
        reached += ready
        left = [index for index in left if not mask[index]]
    return True
