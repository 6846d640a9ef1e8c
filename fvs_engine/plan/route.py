"""The order in which to visit views, so that the way through them is short.

Nearest neighbour, then 2-opt and Or-opt until neither helps: within 1 % of OR-Tools' routes at the size of
a plan (docs/design/planning.md), without a dependency of 30 MB.
"""

import itertools
import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from fvs_schema.candidates import CandidateStatus

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_LONGEST_SEGMENT = 3
"""Maximum number of stops that Or-opt moves together."""
_LEAST = 1e-12
_BLOCKED = 1e3


class Legs(Protocol):
    """Lengths of flight between places, which have indices."""

    def between(self, places: Indices, others: Indices) -> Array:
        """The lengths [len(places), len(others)]; infinite where there is no way."""
        ...

    def way(self, place: int, other: int) -> tuple[int, ...] | None:
        """The places between two of them on the way; None where there is no way."""
        ...

    def straighten(self, flown: Sequence[tuple[int, int]]) -> None:
        """Search shorter ways between pairs of places that will be flown."""
        ...

    def blocked(self, place: int) -> CandidateStatus | None:
        """Why no way leads from a place: it is in a no-fly zone, or too close to matter; else None."""
        ...


class StraightLegs:
    """Straight lines between ``places`` [N, 3]."""

    def __init__(self, places: Array) -> None:
        self._places = places

    def between(self, places: Indices, others: Indices) -> Array:
        """See ``Legs``."""
        apart = self._places[places][:, None] - self._places[others][None]
        return np.asarray(np.linalg.norm(apart, axis=-1))

    def way(self, place: int, other: int) -> tuple[int, ...]:  # noqa: ARG002 - straight
        """See ``Legs``."""
        return ()

    def straighten(self, flown: Sequence[tuple[int, int]]) -> None:
        """Do nothing: straight ways are the shortest."""

    def blocked(self, place: int) -> None:
        """See ``Legs``: nothing is in the way."""


def shortest_route(
    legs: Legs, start: int, stops: Sequence[int], end: int | None = None
) -> tuple[tuple[int, ...], float]:
    """A short way from ``start`` through all ``stops``, and on to ``end`` if it is given.

    Returns the stops in the order of the visit, and the length: infinite if there is no way. Deterministic.
    """
    places = np.array([start, *stops, *([] if end is None else [end])], dtype=np.int64)
    lengths = legs.between(places, places)
    blocked = ~np.isfinite(lengths)
    if blocked.any():  # longer than any route, so that routes can still be compared
        lengths = np.where(blocked, _BLOCKED * (1.0 + lengths[~blocked].sum()), lengths)
    last = [] if end is None else [len(places) - 1]
    way = [0, *_nearest_neighbours(lengths, len(stops)), *last]
    # An open end costs nothing: a leg to nowhere, so that both kinds of route are one case.
    if end is None:
        lengths = np.pad(lengths, (0, 1))
        way.append(len(places))
    way = _improved(lengths, way)
    length = _length(lengths, way)
    if any(blocked[leg] for leg in itertools.pairwise(way) if max(leg) < len(places)):
        length = math.inf
    return tuple(int(places[index]) for index in way[1:-1]), length


def _nearest_neighbours(lengths: Array, count: int) -> list[int]:
    way, left = [0], set(range(1, count + 1))
    while left:
        nearest = min(sorted(left), key=lambda index: float(lengths[way[-1], index]))
        way.append(nearest)
        left.remove(nearest)
    return way[1:]


def _improved(lengths: Array, way: list[int]) -> list[int]:
    while True:
        shorter = _reversed_part(lengths, way) or _moved_part(lengths, way)
        if shorter is None:
            return way
        way = shorter


def _reversed_part(lengths: Array, way: list[int]) -> list[int] | None:
    """The best reversal of a part (2-opt); None where none is shorter. The ends of the way stay."""
    stops = np.array(way)
    before, after = stops[:-1], stops[1:]
    legs = lengths[before, after]
    # Legs i < j are replaced by i → j's start and i's end → j's end.
    gain = legs[:, None] + legs[None] - lengths[before[:, None], before] - lengths[after[:, None], after]
    i, j = np.unravel_index(int(np.argmax(np.triu(gain, 2))), gain.shape)
    if gain[i, j] <= _LEAST or j < i + 2:
        return None
    return [*way[: i + 1], *way[i + 1 : j + 1][::-1], *way[j + 1 :]]


def _moved_part(lengths: Array, way: list[int]) -> list[int] | None:
    """The best move of up to ``_LONGEST_SEGMENT`` stops elsewhere, also reversed (Or-opt)."""
    best, found = _LEAST, None
    for size in range(1, _LONGEST_SEGMENT + 1):
        for i in range(1, len(way) - size):
            part, rest = way[i : i + size], np.array([*way[:i], *way[i + size :]])
            saved = (
                lengths[way[i - 1], part[0]]
                + lengths[part[-1], way[i + size]]
                - lengths[way[i - 1], way[i + size]]
            )
            a, b = rest[:-1], rest[1:]
            for turned in (part, part[::-1]):
                gain = saved - (lengths[a, turned[0]] + lengths[turned[-1], b] - lengths[a, b])
                place = int(np.argmax(gain))
                if gain[place] > best:
                    best = float(gain[place])
                    found = [*rest[: place + 1].tolist(), *turned, *rest[place + 1 :].tolist()]
    return found


def _length(lengths: Array, way: Sequence[int]) -> float:
    return float(lengths[list(way[:-1]), list(way[1:])].sum())
