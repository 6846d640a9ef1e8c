"""The outlook of a selection: how well its targets are known now, after the next view, and at the end."""

from collections.abc import Sequence

import numpy as np

from fvs_engine.plan.distances import spread, view_points
from fvs_engine.plan.forecast import LEAST_PHOTOGRAPHS, Forecast, PsnrForecast, Seen
from fvs_engine.plan.kriging import TargetVariance, variances
from fvs_engine.plan.planner import Admissible, plan_views
from fvs_engine.plan.registration import Familiarity
from fvs_engine.records import Record
from fvs_engine.select.interface import SelectionContext
from fvs_engine.views import PinholeView


class Expectation(Record):
    """The mean kriging variance over the targets, and the PSNR to expect of them.

    ``forecast`` is None as long as too few photographs were seen.
    """

    variance: float
    forecast: Forecast | None


class Outlook(Record):
    """What to expect ``now``, after the view that gains most in reach, and at the ``end`` of the best plan.

    ``gain_db`` is what the next view adds; None without a forecast.
    """

    now: Expectation
    after_next: Expectation
    end: Expectation
    gain_db: float | None


class Targets:
    """The targets of a context, and the views that may be visited, as points of ``view_points``."""

    def __init__(self, context: SelectionContext) -> None:
        self.later = context.later or context.candidates
        targets = context.targets or (*context.visited, *self.later)
        self.spread = spread(targets)
        self.visited = view_points(context.visited, self.spread)
        self.points = view_points(self.later, self.spread)
        self.variance = TargetVariance(view_points(targets, self.spread), self.points, self.visited)
        self.index = {view.name: index for index, view in enumerate(self.later)}
        self.admissible = _admissible(context)
        self.remaining = max(1, context.budget - len(context.visited))

    def variance_of(self, name: str) -> float:
        """The kriging variance of one of ``later``."""
        at = self.index[name]
        return float(variances(self.points[at : at + 1], self.visited)[0])

    def registrable(self, candidates: Sequence[PinholeView]) -> tuple[PinholeView, ...]:
        """Those that are likely to be registered; all of them where none is."""
        mask = self.admissible([])
        return tuple(view for view in candidates if mask[self.index[view.name]]) or tuple(candidates)

    def outlook(self, context: SelectionContext, seen: Sequence[Seen]) -> Outlook:
        """What to expect, by the photographs ``seen`` so far."""
        line = PsnrForecast(seen) if len(seen) >= LEAST_PHOTOGRAPHS else None

        def expectation(variance: float) -> Expectation:
            return Expectation(variance=variance, forecast=line.at(variance) if line else None)

        reachable = [self.index[view.name] for view in context.candidates]
        gain = float(self.variance.gains([], np.array(reachable)).max(initial=0.0))
        now = self.variance.variance
        end = plan_views(self.variance, self.remaining, self.admissible).variance_after
        return Outlook(
            now=expectation(now),
            after_next=expectation(now - gain),
            end=expectation(end),
            gain_db=line.gain_db(now, now - gain) if line else None,
        )


def _admissible(context: SelectionContext) -> Admissible:
    """Which views can be registered beside planned ones: all of them where poses are known."""
    later = context.later or context.candidates
    if context.observations is None or not len(context.observations.points):
        everything = np.ones(len(later), dtype=bool)
        return lambda _plan: everything
    return Familiarity(context.observations, later).enough
