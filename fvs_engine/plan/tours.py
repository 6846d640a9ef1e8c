"""Plans with a budget of distance, and for several vehicles: an orienteering problem.

Source: Vansteenwegen, Souffriau, Van Oudheusden, "The orienteering problem: A survey", EJOR 2011: insertion
by gain per length, then exchanges and shorter routes. Here the gain of a view depends on the others.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.kriging import TargetVariance
from fvs_engine.plan.planner import Admissible, Mask, plan_views, stands_alone
from fvs_engine.plan.reach import rounded_up
from fvs_engine.plan.route import Legs, shortest_route

Array = NDArray[np.float64]

_ROUNDS = 4
_MOST_LEVELINGS = 100
_EXCHANGED = 3
"""Number of views of another tour that one is exchanged for."""
_LEAST_GAIN = 1e-9
_TOLERANCE = 1e-9
"""Tolerance for rounding, as a share of the distance."""


@dataclass(frozen=True)
class Tour:
    """The way of one vehicle: ``views``, indices of candidates in the order of visit, and its ``length``."""

    views: tuple[int, ...]
    length: float


@dataclass(frozen=True)
class Budget:
    """The budget of a plan: ``views`` in all, and a ``distance`` for each vehicle; None is no limit.

    With ``home`` every vehicle flies back to its start, which counts. ``flown``: what each vehicle has flown
    already, which counts too (empty: nothing). ``scale``: the length of one unit of ``distance`` in the unit
    of messages. Raises ``InvalidInputError`` for numbers that are not positive.
    """

    views: int
    distance: float | None = None
    home: bool = False
    flown: tuple[float, ...] = ()
    scale: float = 1.0

    def __post_init__(self) -> None:
        if self.views < 1:
            raise InvalidInputError(f"A plan needs at least one view, not {self.views}.")
        if self.distance is not None and not 0.0 < self.distance < np.inf:
            raise InvalidInputError(
                f"The distance of a plan must be positive, not {self.distance:g}.",
                hint="Give a longer one, or none where there is no limit.",
            )

    def before(self, vehicle: int) -> float:
        """How far a vehicle has flown before its tour."""
        return self.flown[vehicle] if self.flown else 0.0

    def left(self, vehicle: int) -> float:
        """The length that the tour of a vehicle may have; infinite without a limit."""
        if self.distance is None:
            return np.inf
        return max(0.0, self.distance * (1 + _TOLERANCE) - self.before(vehicle))

    def there(self, length: float) -> float:
        """The length of a tour to one view at the end of a way of this ``length``."""
        return 2.0 * length if self.home else length


def plan_tours(
    variance: TargetVariance,
    budget: Budget,
    admissible: Admissible,
    legs: Legs,
    starts: Sequence[int],
) -> tuple[Tour, ...]:
    """Plan a tour for each vehicle. Places in ``legs`` are the candidates, then others such as ``starts``.

    Raises ``InvalidInputError`` without vehicles, where no candidate is admissible and where the distance
    does not reach any.
    """
    if not starts:
        raise InvalidInputError("A plan needs at least one vehicle.")
    reachable = _reachable(budget, admissible, legs, starts)

    def open_to(plan: Sequence[int]) -> Mask:
        return np.asarray(admissible(plan) & reachable)

    planner = _Tours(variance, budget, open_to, legs, starts)
    if budget.distance is None:
        planner.share(plan_views(variance, budget.views, open_to).chosen)
        return planner.tours
    # Which of the two ways to fill tours is better depends on how tight the distance is.
    found = []
    for power in (0.5, 1.0):
        planner = _Tours(variance, budget, open_to, legs, starts)
        planner.fill(power)
        planner.exchange(power)
        found.append(planner)
    return min(found, key=lambda each: variance.variance_after(each.chosen)).tours


class _Tours:
    """Tours that are being planned; all lengths include the way home where that is asked for."""

    def __init__(
        self,
        variance: TargetVariance,
        budget: Budget,
        admissible: Admissible,
        legs: Legs,
        starts: Sequence[int],
    ) -> None:
        self._variance = variance
        self._budget = budget
        self._admissible = admissible
        self._legs = legs
        self._starts = starts
        self.tours: tuple[Tour, ...] = tuple(Tour((), 0.0) for _ in starts)

    @property
    def chosen(self) -> tuple[int, ...]:
        """All planned views."""
        return tuple(index for tour in self.tours for index in tour.views)

    def share(self, views: Sequence[int]) -> None:
        """Share out views, so that the longest tour is short: always the one that a tour is shortest with."""
        left = np.array(sorted(views), dtype=np.int64)
        while len(left):
            lengths = np.stack([self._flown(v) + self._insertions(v, left) for v in range(len(self.tours))])
            vehicle, place = np.unravel_index(int(np.argmin(lengths)), lengths.shape)
            self._insert(int(vehicle), int(left[place]))
            left = np.delete(left, place)
        self._level()

    def fill(self, power: float) -> None:
        """Add the view with the highest gain per ``power`` of the length that it adds, while one fits."""
        while len(self.chosen) < self._budget.views:
            gains = self._variance.gains(self.chosen)
            open_to = self._admissible(self.chosen).copy()
            open_to[list(self.chosen)] = False
            added, vehicles = self._added(np.flatnonzero(open_to))
            candidates = np.flatnonzero(open_to)
            worth = np.where(
                np.isfinite(added), gains[candidates] / np.maximum(added, 1e-9) ** power, -np.inf
            )
            if not len(worth) or worth.max() == -np.inf:
                return
            best = int(np.argmax(worth))
            self._insert(int(vehicles[best]), int(candidates[best]))

    def exchange(self, power: float) -> None:
        """Replace views by others while that lowers the variance, and fill the distance that is left."""
        for _ in range(_ROUNDS):
            before = self.chosen
            for index in before:
                self._exchange_one(index, power)
            if set(self.chosen) == set(before):
                return

    def _exchange_one(self, index: int, power: float) -> None:
        kept, after = self.tours, self._variance.variance_after(self.chosen)
        vehicle = next(number for number, tour in enumerate(self.tours) if index in tour.views)
        self._replace(vehicle, self._routed(vehicle, [i for i in self.tours[vehicle].views if i != index]))
        rest = self.chosen
        if stands_alone(rest, self._admissible):
            open_to = self._admissible(rest).copy()
            open_to[[*rest, index]] = False
            candidates = np.flatnonzero(open_to)
            added, vehicles = self._added(candidates)
            gains = np.where(np.isfinite(added), self._variance.gains(rest)[candidates], -np.inf)
            if len(gains) and gains.max() > -np.inf:
                best = int(np.argmax(gains))
                self._insert(int(vehicles[best]), int(candidates[best]))
                self.fill(power)
        if self._variance.variance_after(self.chosen) >= after - _LEAST_GAIN:
            self.tours = kept

    def _added(self, candidates: NDArray[np.int64]) -> tuple[Array, NDArray[np.int64]]:
        """The least length that each of ``candidates`` adds to a tour, and whose tour that is.

        Infinite where no tour can take it.
        """
        best = np.full(len(candidates), np.inf)
        whose = np.zeros(len(candidates), dtype=np.int64)
        for vehicle, tour in enumerate(self.tours):
            added = self._insertions(vehicle, candidates)
            added = np.where(tour.length + added <= self._budget.left(vehicle), added, np.inf)
            better = added < best
            best, whose = np.where(better, added, best), np.where(better, vehicle, whose)
        return best, whose

    def _insertions(self, vehicle: int, candidates: NDArray[np.int64]) -> Array:
        """The length that each of ``candidates`` adds to a tour at its best position."""
        start, tour = self._starts[vehicle], self.tours[vehicle]
        way = np.array([start, *tour.views, *([start] if self._budget.home else [])])
        lengths = self._legs.between(way, candidates)
        along = np.array(
            [self._legs.between(way[i : i + 1], way[i + 1 : i + 2])[0, 0] for i in range(len(way) - 1)]
        )
        options = (
            lengths[:-1] + lengths[1:] - along[:, None] if len(way) > 1 else np.empty((0, len(candidates)))
        )
        if not self._budget.home:
            options = np.concatenate([options, lengths[-1:]])
        return np.asarray(options.min(axis=0))

    def _insert(self, vehicle: int, index: int) -> None:
        self._replace(vehicle, self._routed(vehicle, [*self.tours[vehicle].views, index]))

    def _level(self) -> None:
        """Give views of the longest tour to others, or exchange them, while the longest one gets shorter."""
        for _ in range(_MOST_LEVELINGS):
            shorter = self._leveled()
            if shorter is None:
                return
            self.tours = shorter

    def _leveled(self) -> tuple[Tour, ...] | None:
        longest = max(range(len(self.tours)), key=self._flown)
        mine, limit = self.tours[longest].views, self._flown(longest) - 1e-9
        for vehicle, tour in enumerate(self.tours):
            if vehicle == longest:
                continue
            for index in mine:
                rest = [other for other in mine if other != index]
                for given in ([], *([other] for other in self._nearest(index, tour.views))):
                    taken = [other for other in tour.views if other not in given]
                    changed = {
                        longest: self._routed(longest, [*rest, *given]),
                        vehicle: self._routed(vehicle, [*taken, index]),
                    }
                    if max(self._budget.before(v) + each.length for v, each in changed.items()) < limit:
                        return tuple(changed.get(v, each) for v, each in enumerate(self.tours))
        return None

    def _flown(self, vehicle: int) -> float:
        """How far a vehicle will have flown at the end of its tour."""
        return self._budget.before(vehicle) + self.tours[vehicle].length

    def _nearest(self, index: int, views: Sequence[int]) -> list[int]:
        """The few of ``views`` that are nearest to a view."""
        lengths = self._legs.between(np.array([index]), np.array(views, dtype=np.int64))[0]
        return [views[place] for place in np.argsort(lengths, kind="stable")[:_EXCHANGED]]

    def _routed(self, vehicle: int, views: Sequence[int]) -> Tour:
        start = self._starts[vehicle]
        order, length = shortest_route(self._legs, start, views, start if self._budget.home else None)
        return Tour(order, length)

    def _replace(self, vehicle: int, tour: Tour) -> None:
        self.tours = (*self.tours[:vehicle], tour, *self.tours[vehicle + 1 :])


def _reachable(budget: Budget, admissible: Admissible, legs: Legs, starts: Sequence[int]) -> Mask:
    """Which candidates [n] any vehicle can reach, at any length; raises where the distance reaches none."""
    possible = admissible([])
    if not possible.any():
        raise InvalidInputError(
            "No candidate can be visited.",
            hint="Give candidates nearer to the photographs, so that they can be registered.",
        )
    lengths = legs.between(np.array(starts), np.arange(len(possible)))
    reachable = np.isfinite(lengths.min(axis=0))
    if not (possible & reachable).any():
        raise InvalidInputError(
            "No candidate can be reached from where the vehicle is.",
            hint="Something is in the way: give another start, or candidates on this side.",
        )
    nearest = lengths[:, possible & reachable].min(axis=1)
    distance = np.inf if budget.distance is None else budget.distance
    if not any(budget.there(length) <= budget.left(vehicle) for vehicle, length in enumerate(nearest)):
        given, away = (budget.scale * float(length) for length in (distance, nearest.min()))
        raise InvalidInputError(
            f"A distance of {given:.4g} does not reach any candidate: the nearest is {away:.4g} away.",
            hint=f"Give at least {least_distance(budget, float(nearest.min())):.4g} for the way, or nearer "
            "candidates.",
        )
    return np.asarray(reachable)


def least_distance(budget: Budget, nearest: float) -> float:
    """The distance that suffices for the way to the ``nearest`` candidate, and back where it must."""
    return rounded_up(budget.scale * budget.there(nearest))
