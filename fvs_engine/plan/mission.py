"""A mission: which views to visit, by which vehicle and in which order, and what that brings, explained."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.forecast import Seen
from fvs_engine.plan.outlook import Expectations
from fvs_engine.plan.plan_records import Mission, Stop, Term, VehicleTour
from fvs_engine.plan.route import Legs, StraightLegs
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget, plan_tours

Array = NDArray[np.float64]

_HELPED = 3
"""Targets that a candidate helps most which are named."""
MOST_TERMS = 2_000
"""Candidates of a mission that are explained."""


def plan_mission(
    targets: Targets,
    budget: Budget,
    starts: Sequence[Array],
    seen: Sequence[Seen] = (),
    legs: Legs | None = None,
) -> Mission:
    """Plan for vehicles at ``starts`` [3] each.

    Places in ``legs`` are the later views of ``targets``, then the starts; by default straight lines. Raises
    what ``plan_tours`` raises, and ``InvalidInputError`` without candidates.
    """
    if not targets.later:
        raise InvalidInputError(
            "There is no candidate to plan with.", hint="Give poses that can be flown to."
        )
    count = len(targets.later)
    places = np.concatenate([targets.centres, np.reshape(starts, (-1, 3))])
    legs = legs or StraightLegs(places)
    vehicles = range(count, len(places))
    tours = plan_tours(targets.variance, budget, targets.admissible, legs, vehicles)
    expectations = Expectations(seen)
    chosen = [index for tour in tours for index in tour.views]
    travels = [_travels(legs, start, tour.views) for start, tour in zip(vehicles, tours, strict=True)]
    arrivals = sorted(
        (float(travel), index)
        for tour, along in zip(tours, travels, strict=True)
        for index, travel in zip(tour.views, along, strict=True)
    )
    flown = [index for _, index in arrivals]
    after = {
        index: expectations.at(targets.variance.variance_after(flown[: place + 1]))
        for place, index in enumerate(flown)
    }
    return Mission(
        now=expectations.at(targets.variance.variance),
        end=expectations.at(targets.variance.variance_after(chosen)),
        tours=tuple(
            VehicleTour(
                start=tuple(places[start].tolist()),
                stops=tuple(
                    Stop(
                        name=targets.later[index].name,
                        distance=float(travel - before),
                        travel=float(travel),
                        after=after[index],
                        via=tuple(tuple(places[on].tolist()) for on in legs.way(last, index) or ()),
                    )
                    for index, travel, before, last in zip(
                        tour.views, along, (0.0, *along), (start, *tour.views), strict=False
                    )
                ),
                length=tour.length,
            )
            for start, tour, along in zip(vehicles, tours, travels, strict=True)
        ),
        terms=_terms(targets, chosen, legs, vehicles),
        target_variances=tuple(
            zip(targets.variances_after([]).tolist(), targets.variances_after(chosen).tolist(), strict=True)
        ),
    )


def _travels(legs: Legs, start: int, views: Sequence[int]) -> list[float]:
    """The length of the way up to each view of a tour."""
    way = np.array([start, *views], dtype=np.int64)
    steps = [float(legs.between(way[i : i + 1], way[i + 1 : i + 2])[0, 0]) for i in range(len(views))]
    return np.cumsum(steps).tolist() if steps else []


def _terms(targets: Targets, chosen: Sequence[int], legs: Legs, vehicles: Sequence[int]) -> tuple[Term, ...]:
    """Of all planned views, and of the others that would gain most beside them."""
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
            distance=float(distance),
            chance=float(chances[index]) if chances is not None else None,
            helps=targets.variance.helped(index, _HELPED),
        )
        for index, distance in zip(order.tolist(), distances.tolist(), strict=True)
    )
