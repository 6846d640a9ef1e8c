"""The vehicles of a selection: where each of them is, how far it has flown, and whose turn it is."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.plan.fleet import Fleet
from fvs_engine.plan.tours import Budget
from fvs_engine.select.loop_records import Choice

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Vehicle:
    """A vehicle at the view ``at``, which has ``flown`` since the initial views; ``number`` counts from 1."""

    number: int
    at: str
    flown: float


class Vehicles:
    """The vehicles of a selection after ``choices``; all began at the view ``start``.

    Each step is flown by the vehicle that has flown least, the first of several. A vehicle whose next view
    would exceed ``max_travel`` (None: no limit), or to which nothing is in reach, flies no more.
    """

    def __init__(self, count: int, start: str, max_travel: float | None, choices: Sequence[Choice]) -> None:
        self._max_travel = max_travel
        vehicles = {number: Vehicle(number, start, 0.0) for number in range(1, count + 1)}
        for choice in choices:
            flown = vehicles[choice.vehicle].flown + choice.distance
            vehicles[choice.vehicle] = Vehicle(choice.vehicle, choice.chosen, flown)
        self.all = tuple(vehicles.values())
        """In the order of their numbers."""
        self.landed = choices[-1].landed if choices else ()
        """The numbers of the vehicles that have stopped."""
        flying = (vehicle for vehicle in self.all if vehicle.number not in self.landed)
        self.in_turn = tuple(sorted(flying, key=lambda vehicle: (vehicle.flown, vehicle.number)))
        """The vehicles that still fly; the first one has the next turn."""

    def left(self, vehicle: Vehicle) -> float:
        """How far a vehicle may still fly; infinite without a limit."""
        return Budget(1, self._max_travel, flown=(vehicle.flown,)).left(0)

    def fleet(self, first: Vehicle, centres: Mapping[str, Array], scale: float) -> Fleet | None:
        """The vehicles for a plan: ``first`` and those behind it; None for one without a limit.

        Those whose turn was before cannot go on.

        ``centres``: of visited views, in the model frame; ``scale``: its units per unit of the dataset.
        """
        if self._max_travel is None and len(self.all) == 1:
            return None
        order = self.in_turn[self.in_turn.index(first) :] if first in self.in_turn else (first,)
        return Fleet(
            np.stack([centres[vehicle.at] for vehicle in order]),
            tuple(vehicle.flown * scale for vehicle in order),
            None if self._max_travel is None else self._max_travel * scale,
        )
