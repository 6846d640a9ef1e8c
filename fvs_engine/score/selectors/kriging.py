"""Kriging selector: plans the views that leave the least variance of the targets at the end of the budget."""

import math

import numpy as np
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.plan.beam_search import plan_way
from fvs_engine.plan.fleet import FleetPlan
from fvs_engine.plan.planner import plan_views
from fvs_engine.plan.route import StraightLegs, shortest_route
from fvs_engine.plan.targets import Targets
from fvs_engine.score import CandidateScore
from fvs_engine.score.selectors.interface import SelectionContext
from fvs_schema.candidates import CandidateStatus

TRAVEL = 1e-4
"""Price of travel, in variance per spread of the targets: some 0.002 dB. It orders planned views."""


class Kriging:
    """Scores a candidate by the mean kriging variance of the targets at the end of the budget.

    All remaining views are planned at every step (``plan_views``, or ``plan_way`` where reach is limited),
    and the score is what the plan leaves if the candidate is visited next. All planned views would score the
    same, so a small price for travel puts the first stop of the shortest route first. Where poses are
    estimated, the plan keeps to views that are likely to be registered (``Familiarity``).

    With a ``fleet``, the plan keeps to the distance that is left, and its vehicles share it (``FleetPlan``).
    Where reach is limited, each vehicle plans an equal share of the views, beside what all have visited.

    Score: mean kriging variance that the plan leaves, no unit: 1 where nothing is known; 0 to 1, and up to
    0.01 more for the way. Source: I-optimal design for kriging (Müller, "Collecting Spatial Data", 2007),
    with exchanges (Fedorov) instead of greedy choice. Cost: targets × candidates once, some milliseconds for
    250 poses; nothing is rendered.
    """

    name = "kriging"

    def score(
        self,
        context: SelectionContext,
        monitor: Monitor | None = None,  # noqa: ARG002 - over at once
    ) -> tuple[CandidateScore, ...]:
        """See ``Selector``. A budget that is used up counts as one remaining view."""
        targets = context.planning
        planned, travel = _planned(context, targets)
        price = TRAVEL / targets.spread if targets.spread > 0 else 0.0
        # A view that cannot be registered does not lower the variance. Where none in reach can be, the
        # likeliest goes first: it leads back to what is known.
        unlikely = targets.variance.variance + TRAVEL * (1.0 - targets.chances)
        ends = np.where(np.isfinite(planned), planned, unlikely) + price * travel
        return tuple(
            CandidateScore(view.name, float(ends[targets.index[view.name]]), CandidateStatus.RANKED, None)
            for view in context.candidates
        )


def _planned(context: SelectionContext, targets: Targets) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The variance at the end of the plan, and how far the camera travels, if it goes to each view next."""
    centres, fleet = targets.centres, context.fleet
    here = centres.mean(axis=0) if context.centre is None else context.centre
    if context.reach is not None and not context.reach.reaches_all(len(centres)):
        plan = plan_way(
            targets.variance,
            context.remaining if fleet is None else math.ceil(context.remaining / len(fleet.centres)),
            targets.admissible,
            centres=centres,
            here=here,
            reach=context.reach,
            distance=None if fleet is None or fleet.distance is None else fleet.left,
        )
        return plan.ends, np.zeros(len(centres))
    if fleet is not None:
        return FleetPlan(targets, context.remaining, fleet).ends()
    plan = plan_views(targets.variance, context.remaining, targets.admissible)
    last = len(centres)  # the place of the camera
    legs = StraightLegs(np.concatenate([centres, here[None]]))
    travel = (
        legs.between(np.arange(last), np.array([last]))[:, 0] + shortest_route(legs, last, plan.chosen)[1]
    )
    for index in plan.chosen:
        rest = [other for other in plan.chosen if other != index]
        travel[index] = np.linalg.norm(centres[index] - here) + shortest_route(legs, index, rest)[1]
    return plan.ends, travel
