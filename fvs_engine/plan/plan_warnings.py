"""Findings about candidates and plans: what cannot be photographed, registered, planned or flown."""

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence

import numpy as np

from fvs_engine.geometry.ground import GroundCheck
from fvs_engine.plan.plan_records import Term
from fvs_engine.plan.planner import Mask
from fvs_engine.plan.route import Legs
from fvs_engine.plan.tours import Budget, Tour, least_distance
from fvs_engine.wording import AGAINST
from fvs_schema.candidates import CandidateStatus
from fvs_schema.findings import Finding, FindingCode

_FEW = 3


def few_registrable(registrable: int | None, candidates: int) -> Iterator[Finding]:
    """The finding that fewer than three ``candidates`` are ``registrable`` (None: that was not computed)."""
    if registrable is not None and registrable < min(_FEW, candidates):
        yield Finding.of(FindingCode.FEW_REGISTRABLE, registrable=registrable, of=candidates)


def none_feasible(statuses: Iterable[CandidateStatus]) -> Iterator[Finding]:
    """The finding that no candidate is feasible, of one or more."""
    counts = Counter(statuses)
    if counts and counts.keys() <= AGAINST.keys():
        against = {status.value: float(count) for status, count in counts.items()}
        found = Finding.of(FindingCode.NONE_FEASIBLE, of=counts.total())
        yield found.model_copy(update={"numbers": found.numbers | against})


def grounded_vehicles(
    tours: Sequence[Tour], budget: Budget, possible: Mask, legs: Legs, starts: Sequence[int]
) -> Iterator[Finding]:
    """The vehicles without a tour that cannot fly to any ``possible`` candidate [n], and why.

    A vehicle that could fly, but is not needed, is not among them.
    """
    candidates, of = np.flatnonzero(possible), len(starts)
    for number, (start, tour) in enumerate(zip(starts, tours, strict=True), start=1):
        if tour.views:
            continue
        nearest = float(legs.between(np.array([start]), candidates).min(initial=np.inf))
        if (blocked := legs.blocked(start)) is not None:
            code = FindingCode.VEHICLE_BLOCKED
            yield Finding.of(code, vehicle=number, of=of, status=blocked.value)
        elif not np.isfinite(nearest):
            yield Finding.of(FindingCode.VEHICLE_WITHOUT_WAY, vehicle=number, of=of)
        elif budget.there(nearest) > budget.left(number - 1):
            yield Finding.of(
                FindingCode.VEHICLE_OUT_OF_RANGE,
                vehicle=number,
                of=of,
                distance=budget.scale * budget.left(number - 1),
                nearest=budget.scale * nearest,
                least=least_distance(budget, nearest),
            )


def unreachable_candidates(count: int, legs: Legs, starts: Sequence[int]) -> Iterator[Finding]:
    """The finding that no way leads to some of the ``count`` candidates."""
    lengths = legs.between(np.array(starts), np.arange(count)).min(axis=0)
    if missed := int(np.isinf(lengths).sum()):
        yield Finding.of(FindingCode.UNREACHABLE, missed=missed, of=count)


def candidates_too_close(left_out: int, count: int) -> Iterator[Finding]:
    """The finding that ``left_out`` of ``count`` candidates are where no camera can be."""
    if left_out:
        yield Finding.of(FindingCode.TOO_CLOSE, left_out=left_out, of=count)


def ground_findings(ground: GroundCheck) -> Iterator[Finding]:
    """The findings that some candidates are under the ground, or where it has no height."""
    if ground.under:
        yield Finding.of(FindingCode.UNDER_GROUND, candidates=ground.under, of=ground.compared)
    yield from unknown_ground(ground)


def unknown_ground(ground: GroundCheck) -> Iterator[Finding]:
    """The finding that it is not known of some candidates whether they are under the ground."""
    if ground.unknown:
        yield Finding.of(FindingCode.GROUND_UNKNOWN, candidates=ground.unknown, of=ground.compared)


def copied_candidates(one_of_pose: Mask) -> Iterator[Finding]:
    """The finding that some candidates [n] have the pose of another one; ``one_of_pose`` has one of each."""
    if copies := int((~one_of_pose).sum()):
        yield Finding.of(FindingCode.SAME_POSE, copies=copies, of=len(one_of_pose))


def nothing_in_view(terms: Sequence[Term]) -> Iterator[Finding]:
    """The finding that none of the planned candidates among ``terms`` shows anything of the model."""
    planned = [term for term in terms if term.planned]
    if planned and all(term.coverage == 0.0 for term in planned):
        yield Finding.of(FindingCode.NOTHING_IN_VIEW)
