"""Vehicles in flight, and the variance at the end if one of them visits a candidate next."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from fvs_engine.plan.route import StraightLegs, shortest_route
from fvs_engine.plan.targets import Targets
from fvs_engine.plan.tours import Budget, Tour, plan_tours

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Fleet:
    """Vehicles at ``centres`` [V, 3] that have ``flown`` [V] of a ``distance`` for each; None: no limit.

    The first one flies next.
    """

    centres: Array
    flown: tuple[float, ...]
    distance: float | None = None

    @property
    def left(self) -> float:
        """How far the first vehicle may still fly; infinite without a limit."""
        return Budget(1, self.distance, flown=self.flown).left(0)

    @property
    def alone(self) -> "Fleet":
        """The first vehicle without the others."""
        return Fleet(self.centres[:1], self.flown[:1], self.distance)


class FleetPlan:
    """Tours of a fleet through later views of ``targets``, at most ``views`` in all, along straight lines.

    A vehicle to which the plan gives nothing while others fly is planned for alone, when it is the first.
    """

    def __init__(self, targets: Targets, views: int, fleet: Fleet) -> None:
        self._targets = targets
        self._views = views
        self._fleet = fleet
        self._legs = StraightLegs(np.concatenate([targets.centres, fleet.centres]))
        self._here = len(targets.later)
        self.tours = self._planned(fleet)
        """One for each vehicle; all are empty where nothing that can be registered is within the distance."""

    @property
    def variance_after(self) -> float:
        """The mean variance over targets once all tours were flown."""
        return self._targets.variance.variance_after([i for tour in self.tours for i in tour.views])

    def ends(self) -> tuple[Array, Array]:
        """The variance left if the first vehicle visits each later view [n] next, and how far it flies [n].

        From there it continues its tour, as far as the distance and the number of views allow; the
        others fly their tours. Infinite for what cannot be registered now, or is farther than the distance.
        """
        variance, reached = self._targets.variance, self._from_here
        ends, travel = np.full(self._here, np.inf), np.full(self._here, np.inf)
        own, others = self._shares
        for count in range(len(own), -1, -1):  # as many stops as fit
            stops = own[:count]
            plan = [*others, *stops]
            lengths = reached + self._on(stops)
            fits = (lengths <= self._fleet.left) & np.isinf(ends)
            if len(plan) == self._views:  # no room for another one
                fits &= np.isin(np.arange(self._here), plan)
            gains = variance.gains(plan)
            gains[plan] = 0.0  # a view that is in the plan already
            ends[fits] = variance.variance_after(plan) - gains[fits]
            travel[fits] = lengths[fits]
        for index in own:
            ends[index], travel[index] = self._by_way_of(index, own, others)
        ends[~self._targets.admissible([])] = np.inf
        return ends, np.where(np.isfinite(ends), travel, 0.0)

    @cached_property
    def _shares(self) -> tuple[tuple[int, ...], list[int]]:
        """The stops of the first vehicle, and those of the others."""
        own, *others = self.tours
        if not own.views and any(tour.views for tour in others):
            return self._planned(self._fleet.alone)[0].views, []
        return own.views, [index for tour in others for index in tour.views]

    @cached_property
    def _from_here(self) -> Array:
        """Distance of the first vehicle to each later view, [n]."""
        return np.asarray(self._legs.between(np.array([self._here]), np.arange(self._here))[0])

    def _planned(self, fleet: Fleet) -> tuple[Tour, ...]:
        vehicles = range(self._here, self._here + len(fleet.centres))
        budget = Budget(self._views, fleet.distance, flown=fleet.flown)
        ways = self._legs.between(np.array(vehicles), np.arange(self._here))
        left = np.array([budget.left(vehicle) for vehicle in range(len(vehicles))])
        if not (self._targets.admissible([]) & (ways <= left[:, None]).any(axis=0)).any():
            return tuple(Tour((), 0.0) for _ in vehicles)
        targets = self._targets
        return plan_tours(targets.variance, budget, targets.admissible, self._legs, vehicles)

    def _on(self, stops: Sequence[int]) -> Array:
        """Length of the path from each later view [n] through ``stops``."""
        if not stops:
            return np.zeros(self._here)
        to_first = self._legs.between(np.arange(self._here), np.array(stops[:1]))[:, 0]
        return np.asarray(to_first + self._lengths(stops)[-1])

    def _lengths(self, stops: Sequence[int]) -> Array:
        """How far it is along ``stops`` from the first to each of them."""
        steps = self._legs.between(np.array(stops), np.array(stops))
        return np.concatenate([[0.0], np.cumsum(steps[np.arange(len(stops) - 1), np.arange(1, len(stops))])])

    def _by_way_of(self, index: int, own: Sequence[int], others: Sequence[int]) -> tuple[float, float]:
        """Remaining variance and distance if the vehicle goes to one of its own stops first."""
        rest = [other for other in own if other != index]
        order, _ = shortest_route(self._legs, index, rest)
        way = [index, *order]
        lengths = self._from_here[index] + self._lengths(way)
        count = int((lengths <= self._fleet.left).sum())
        if count == 0:
            return np.inf, np.inf
        return self._targets.variance.variance_after([*others, *way[:count]]), float(lengths[count - 1])
