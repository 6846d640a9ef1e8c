"""A plan: which views to visit, by which vehicle and in which order, and what that brings, explained."""

from collections.abc import Sequence
from itertools import accumulate, pairwise

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import even_sample
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.outlook import Expectations
from fvs_engine.plan.plan_records import Plan, Stop, Term, VehicleTour
from fvs_engine.plan.plan_warnings import copied_candidates, grounded_vehicles, unreachable_candidates
from fvs_engine.plan.planner import Mask
from fvs_engine.plan.route import Legs, StraightLegs
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget, plan_tours
from fvs_engine.views import PinholeView
from fvs_engine.wording import NEARER

Array = NDArray[np.float64]

_LEAST_GAIN = 1e-6
"""Fall of the mean variance, as a share of it, below which a candidate and the targets have nothing to do
with each other: some seven spreads of the scene lie between them."""
_HELPED = 3
"""Number of targets named that a candidate helps most."""
MOST_TERMS = 2_000
"""Maximum number of candidates of a plan that are explained."""


def make_plan(
    targets: Targets,
    budget: Budget,
    starts: Sequence[Array],
    seen: Sequence[Seen] = (),
    legs: Legs | None = None,
    monitor: Monitor | None = None,
) -> Plan:
    """Plan for vehicles at ``starts`` [3] each.

    Places in ``legs`` are the later views of ``targets``, then the starts; by default straight lines. Raises
    what ``plan_tours`` raises, and ``InvalidInputError`` without candidates, where none helps the targets and
    where none can be registered; ``Cancelled``.
    """
    monitor = monitor or Monitor()
    if not targets.later:
        raise InvalidInputError(
            "There is no candidate to plan with.", hint="Give poses that can be flown to."
        )
    if targets.variance.gains([]).max() < _LEAST_GAIN * targets.variance.variance:
        raise InvalidInputError(
            "No candidate helps the targets: all are too far from them, or look elsewhere.",
            hint="Give candidates nearer to the targets that look the same way; check that both are in the "
            "frame of the scene.",
        )
    if targets.familiarity is not None and not targets.familiarity.counts.any():
        raise InvalidInputError(
            "No candidate can be registered: none sees a point of the model from where images saw it.",
            hint=NEARER,
        )
    count, one_of_pose = len(targets.later), targets.one_of_pose
    places = np.concatenate([targets.centres, np.reshape(starts, (-1, 3))])
    legs = legs or StraightLegs(places)
    vehicles = range(count, len(places))

    def admissible(plan: Sequence[int]) -> Mask:
        monitor.check()  # asked for before every step of a plan
        return np.asarray(targets.admissible(plan) & one_of_pose)

    tours = plan_tours(targets.variance, budget, admissible, legs, vehicles)
    ways = [
        (start, *tour.views, *([start] if budget.home and tour.views else []))
        for start, tour in zip(vehicles, tours, strict=True)
    ]
    legs.straighten([leg for way in ways for leg in pairwise(way)])
    expectations = Expectations(seen)
    chosen = [index for tour in tours for index in tour.views]
    travels = [_travels(legs, way) for way in ways]
    arrivals = sorted(
        (float(travel), index)
        for tour, along in zip(tours, travels, strict=True)
        for index, travel in zip(tour.views, along, strict=False)  # not the way home
    )
    flown = [index for _, index in arrivals]
    after = {
        index: expectations.at(targets.variance.variance_after(flown[: place + 1]))
        for place, index in enumerate(flown)
    }
    return Plan(
        now=expectations.at(targets.variance.variance),
        end=expectations.at(targets.variance.variance_after(chosen)),
        tours=tuple(
            VehicleTour(
                start=tuple(places[way[0]].tolist()),
                stops=tuple(
                    Stop(
                        name=targets.later[index].name,
                        distance=float(travel - before),
                        travel=float(travel),
                        after=after[index],
                        via=_via(places, legs, last, index),
                    )
                    for index, travel, before, last in zip(
                        tour.views, along, (0.0, *along), way, strict=False
                    )
                ),
                length=along[-1] if along else 0.0,
                via_home=_via(places, legs, *way[-2:]) if budget.home and tour.views else (),
            )
            for way, tour, along in zip(ways, tours, travels, strict=True)
        ),
        terms=_terms(targets, chosen, legs, vehicles),
        targets=targets.names,
        target_variances=tuple(
            zip(targets.variances_after([]).tolist(), targets.variances_after(chosen).tolist(), strict=True)
        ),
        registrable=None if targets.likely is None else int(targets.likely.sum()),
        warnings=(
            *grounded_vehicles(tours, budget, targets.admissible(chosen), legs, vehicles),
            *unreachable_candidates(count, legs, vehicles),
            *copied_candidates(one_of_pose),
        ),
    )


def _via(places: Array, legs: Legs, one: int, other: int) -> tuple[tuple[float, float, float], ...]:
    """The positions to pass between two places."""
    return tuple(tuple(places[on].tolist()) for on in legs.way(one, other) or ())


def _travels(legs: Legs, way: Sequence[int]) -> list[float]:
    """The length of a way from its first place up to each other one."""
    steps = [float(legs.between(np.array([one]), np.array([other]))[0, 0]) for one, other in pairwise(way)]
    return list(accumulate(steps))


def _terms(targets: Targets, chosen: Sequence[int], legs: Legs, vehicles: Sequence[int]) -> tuple[Term, ...]:
    """Terms of all planned views, and of the others that would gain most beside them."""
    gains, beside = targets.variance.gains([]), targets.variance.gains(chosen)
    for index in chosen:
        rest = [other for other in chosen if other != index]
        beside[index] = targets.variance.gains(rest, np.array([index]))[0]
    planned = np.zeros(len(targets.later), dtype=bool)
    planned[list(chosen)] = True
    order = np.lexsort((-beside, ~planned))[:MOST_TERMS]
    own = targets.own_variances()
    distances = legs.between(np.array(vehicles), order).min(axis=0)
    chances = targets.familiarity.probability() if targets.familiarity is not None else None
    return tuple(
        Term(
            name=targets.later[index].name,
            planned=bool(planned[index]),
            gain=float(gains[index]),
            gain_in_plan=float(beside[index]),
            variance=float(own[index]),
            distance=float(distance) if np.isfinite(distance) else None,
            chance=float(chances[index]) if chances is not None else None,
            helps=targets.variance.helped(index, _HELPED),
        )
        for index, distance in zip(order.tolist(), distances.tolist(), strict=True)
    )


_MOST_PRODUCTS = 200**3 * 2_000
"""Maximum number of candidates times the cube of the number of views, which the time of a plan follows."""


def considered(candidates: tuple[PinholeView, ...], views: int, most: int) -> tuple[PinholeView, ...]:
    """Those of ``candidates`` that a plan of so many ``views`` considers: of very many, an even share.

    At most ``most``. Of 100,000, up to 54 views are chosen among all, 100 among 16,000, 200 among 2,000.
    """
    kept = even_sample(len(candidates), min(most, _MOST_PRODUCTS // views**3))
    return tuple(candidates[index] for index in kept)
