"""The order in which to visit views, so that the way through them is short.

Nearest neighbour, then 2-opt and Or-opt until neither helps: within 1 % of OR-Tools' routes at the size of
a plan (docs/adr/0031), without a dependency of 30 MB.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]

_LONGEST_SEGMENT = 3
"""Stops that Or-opt moves together."""
_LEAST = 1e-12


def shortest_route(
    start: ArrayLike, stops: ArrayLike, end: ArrayLike | None = None
) -> tuple[list[int], float]:
    """A short way from ``start`` [3] through all ``stops`` [m, 3], and on to ``end`` [3] if it is given.

    Returns the stops' indices in order, and the length. Straight lines; deterministic.
    """
    points = np.concatenate(
        [
            np.asarray(start, dtype=np.float64).reshape(1, 3),
            np.asarray(stops, dtype=np.float64).reshape(-1, 3),
            np.asarray(end, dtype=np.float64).reshape(-1, 3) if end is not None else np.empty((0, 3)),
        ]
    )
    lengths = np.linalg.norm(points[:, None] - points[None], axis=-1)
    last = [len(points) - 1] if end is not None else []
    stop_count = len(points) - 1 - len(last)
    way = [0, *_nearest_neighbours(lengths, stop_count), *last]
    # An open end costs nothing: a leg to nowhere, so that both kinds of route are one case.
    if end is None:
        lengths = np.pad(lengths, (0, 1))
        way.append(len(points))
    way = _improved(lengths, way)
    return [index - 1 for index in way[1:-1]], _length(lengths, way)


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
