"""Warnings of a plan: vehicles and candidates that it cannot use, and views that show nothing."""

from collections.abc import Iterator, Sequence

import numpy as np

from fvs_engine.plan.plan_records import PlanWarning, Term
from fvs_engine.plan.planner import Mask
from fvs_engine.plan.registrable import ELSEWHERE
from fvs_engine.plan.route import Legs
from fvs_engine.plan.tours import Budget, Tour, least_distance


def grounded_vehicles(
    tours: Sequence[Tour], budget: Budget, possible: Mask, legs: Legs, starts: Sequence[int]
) -> Iterator[PlanWarning]:
    """The vehicles without a tour that cannot fly to any ``possible`` candidate [n], and why.

    A vehicle that could fly, but is not needed, is not among them.
    """
    candidates = np.flatnonzero(possible)
    for vehicle, (start, tour) in enumerate(zip(starts, tours, strict=True)):
        if tour.views:
            continue
        nearest = float(legs.between(np.array([start]), candidates).min(initial=np.inf))
        if (blocked := legs.blocked(start)) is not None:
            why = f"its start is {blocked.where}."
            hint = f"Give it another start, or {blocked.remedy}."
        elif not np.isfinite(nearest):
            why = "no way leads from its start to a candidate."
            hint = "Something is in the way: give it another start, or candidates on its side."
        elif budget.there(nearest) > budget.left(vehicle):
            given, away = (budget.scale * length for length in (budget.left(vehicle), nearest))
            why = f"its distance of {given:.4g} does not reach any candidate; the nearest is {away:.4g} away."
            hint = least_distance(budget, nearest)
        else:
            continue
        yield PlanWarning(
            code="vehicle-grounded",
            message=f"The {_ordinal(vehicle + 1)} of {len(starts)} vehicles gets no tour: {why}",
            hint=hint,
        )


def unreachable_candidates(count: int, legs: Legs, starts: Sequence[int]) -> Iterator[PlanWarning]:
    """How many of ``count`` candidates no way leads to, if any."""
    lengths = legs.between(np.array(starts), np.arange(count)).min(axis=0)
    if missed := int(np.isinf(lengths).sum()):
        yield PlanWarning(
            code="unreachable",
            message=f"{missed:,} of the {count:,} candidates cannot be reached: no-fly zones or the model "
            "are in the way.",
            hint="Give a start on their side, smaller zones or a shorter safety distance.",
        )


def candidates_too_close(left_out: int, count: int) -> Iterator[PlanWarning]:
    """How many of ``count`` candidates were left out because no camera can be there, if any."""
    if left_out:
        yield PlanWarning(
            code="too-close",
            message=f"{left_out:,} of the {count:,} candidates {'is' if left_out == 1 else 'are'} inside "
            "matter, too close to it or in a no-fly zone, and not planned.",
            hint=ELSEWHERE,
        )


def copied_candidates(one_of_pose: Mask) -> Iterator[PlanWarning]:
    """How many candidates [n] have the pose of another that may be planned, if any."""
    if copies := int((~one_of_pose).sum()):
        yield PlanWarning(
            code="same-pose",
            message=f"{copies:,} of the {len(one_of_pose):,} candidates {'has' if copies == 1 else 'have'} "
            "the pose of another: a plan takes one photograph of each pose.",
            hint="Give candidates whose positions or directions differ.",
        )


def nothing_in_view(terms: Sequence[Term]) -> Iterator[PlanWarning]:
    """Whether none of the planned candidates among ``terms`` shows anything of the model."""
    planned = [term for term in terms if term.planned]
    if planned and all(term.coverage == 0.0 for term in planned):
        which = "The planned view shows" if len(planned) == 1 else "None of the planned views shows"
        yield PlanWarning(
            code="nothing-in-view",
            message=f"{which} {'nothing' if len(planned) == 1 else 'anything'} of the model.",
            hint="Give candidates that look at the model, and check that they are in the frame of the scene.",
        )


def _ordinal(number: int) -> str:
    suffixes = {1: "st", 2: "nd", 3: "rd"}
    return f"{number}{'th' if number % 100 in (11, 12, 13) else suffixes.get(number % 10, 'th')}"
