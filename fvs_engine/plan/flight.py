"""Flight: legs around matter and no-fly zones, through other places where there is no straight one."""

import itertools
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.clearance import FreeSpace
from fvs_engine.wording import BLOCKED
from fvs_schema.candidates import CandidateStatus

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

MOST_PLACES = 10_000
_MOST_SEGMENTS = 50_000
"""Maximum number of straight legs that are examined: all between 300 places."""
_LEAST_NEIGHBOURS = 8
_MOST_HELD = 10_000_000
"""Maximum number of cached lengths: 120 MB with the places before the last."""


class FreeLegs:
    """``Legs`` over ``places`` [N, 3] of candidates and starts, through free space.

    A leg is straight where ``space`` lets it, else the shortest way through other places, infinite where
    there is none. Of up to 300 places all pairs are examined. Of more, each place's nearest ones and as many
    drawn evenly from all, so that ways cross gaps between groups: 50,000 pairs together, or 8 for each place.
    A straight leg that was not examined may then be replaced by a way that is a little longer, until
    ``straighten`` examines it; what is returned can always be flown. A place too near to matter, or in a
    zone, has no way.

    Ways are computed from one place to all when first asked for, and the last ones are kept (120 MB).
    Raises ``InvalidInputError`` for more than ``MOST_PLACES``.
    """

    def __init__(self, places: Array, space: FreeSpace) -> None:
        points = np.asarray(places, dtype=np.float64).reshape(-1, 3)
        if len(points) > MOST_PLACES:
            raise InvalidInputError(
                f"A plan can have at most {MOST_PLACES:,} positions, not {len(points):,}.",
                hint="Give fewer candidates.",
            )
        self._points, self._space = points, space
        self._joined: Indices = np.zeros((0, 2), dtype=np.int64)
        self._rows: dict[int, tuple[Array, NDArray[np.int32]]] = {}
        self._join(_pairs(points))

    def between(self, places: Indices, others: Indices) -> Array:
        """See ``Legs``."""
        if len(set(np.asarray(others).tolist())) < len(set(np.asarray(places).tolist())):
            return self.between(others, places).T
        rows = [self._from(int(place))[0][others] for place in places]
        return np.array(rows).reshape(len(places), len(others))

    def way(self, place: int, other: int) -> tuple[int, ...] | None:
        """The places between two on the shortest way, in order: () for a straight leg, None without a way."""
        lengths, before = self._from(place)
        if not np.isfinite(lengths[other]):
            return None
        way: list[int] = []
        while other != place:
            other = int(before[other])
            way.append(other)
        return tuple(reversed(way[:-1]))

    def straighten(self, flown: Sequence[tuple[int, int]]) -> None:
        """Examine all pairs of places along these ways: a straight leg may lead past some of them."""
        ways = [(one, *(self.way(one, other) or ()), other) for one, other in flown]
        # Neighbours on a way are joined already.
        apart = [pair for way in ways for pair in itertools.combinations(way, 2) if len(way) > 2]
        if apart:
            self._join(np.unique(np.sort(np.array(apart, dtype=np.int64), axis=1), axis=0))

    def blocked(self, place: int) -> CandidateStatus | None:
        """See ``Legs``."""
        return _blocked(self._points[place], self._space)

    def _join(self, pairs: Indices) -> None:
        """Add the ``pairs`` [N, 2], the lower index first, between which a straight leg can be flown."""
        from scipy.sparse import csr_array  # slow to import

        points = self._points
        free = self._space.joins(points[pairs[:, 0]], points[pairs[:, 1]])
        self._joined = np.unique(np.concatenate([self._joined, pairs[free]]), axis=0)
        first, second = self._joined.T
        lengths = np.linalg.norm(points[first] - points[second], axis=1)
        # The graph has no edges of length 0, which a sparse matrix would drop.
        lengths = np.maximum(lengths, np.finfo(np.float64).tiny)
        self._graph = csr_array((lengths, (first, second)), shape=(len(points), len(points)))
        self._rows.clear()

    def _from(self, place: int) -> tuple[Array, NDArray[np.int32]]:
        """From a place to all: the lengths, and the place before each."""
        from scipy.sparse.csgraph import dijkstra  # slow to import

        if place not in self._rows:
            lengths, before = dijkstra(self._graph, directed=False, indices=place, return_predecessors=True)
            while self._rows and (len(self._rows) + 1) * len(lengths) > _MOST_HELD:
                del self._rows[next(iter(self._rows))]
            self._rows[place] = lengths, before
        return self._rows[place]


def free_legs(candidates: Array, starts: Array, space: FreeSpace) -> FreeLegs:
    """The legs over ``candidates`` [n, 3] and then ``starts`` [V, 3].

    Raises ``InvalidInputError`` where all candidates, or all starts, are in a zone or too near to matter: no
    way leads to or from them.
    """
    allowed = space.allowed(candidates)
    if not allowed.any():
        raise InvalidInputError(
            f"{_all(len(candidates))} in no-fly zones.",
            hint="Give candidates outside of them, or smaller zones.",
        )
    if not space.clear(candidates[allowed]).any():
        others = "" if allowed.all() else " outside of no-fly zones"
        raise InvalidInputError(
            f"{_all(int(allowed.sum()), others)} inside a solid part of the model, or within the "
            "safety distance of one.",
            hint="Give a shorter safety distance, or candidates farther from the model.",
        )
    obstacles = [_blocked(start, space) for start in starts]
    if (first := obstacles[0]) is not None and None not in obstacles:
        number = f"vehicle 1 of {len(starts)}" if len(starts) > 1 else "the vehicle"
        where, remedy = BLOCKED[first]
        raise InvalidInputError(
            f"The start of {number} is {where}: no way leads out.",
            hint=f"Give another start, or {remedy}.",
        )
    return FreeLegs(np.concatenate([candidates, starts]), space)


def _blocked(point: Array, space: FreeSpace) -> CandidateStatus | None:
    """What keeps all ways from leading from a ``point`` [3]."""
    if not space.allowed(point[None])[0]:
        return CandidateStatus.NO_FLY
    return None if space.clear(point[None])[0] else CandidateStatus.TOO_CLOSE


def _all(count: int, which: str = "") -> str:
    return f"The only candidate{which} is" if count == 1 else f"All {count} candidates{which} are"


def _pairs(points: Array) -> Indices:
    """The pairs [N, 2] of places that are examined, each once, the lower index first."""
    from scipy.spatial import cKDTree  # slow to import

    count = len(points)
    if count * (count - 1) // 2 <= _MOST_SEGMENTS:
        first, second = np.triu_indices(count, 1)
        return np.column_stack([first, second]).astype(np.int64)
    each = max(_LEAST_NEIGHBOURS, _MOST_SEGMENTS // count) // 2
    _, nearest = cKDTree(points).query(points, k=each + 1)
    drawn = np.random.default_rng(0).integers(count, size=(count, each))
    others = np.concatenate([nearest, drawn], axis=1)
    first = np.repeat(np.arange(count), others.shape[1])
    pairs = np.sort(np.column_stack([first, others.ravel()]), axis=1)
    return np.asarray(np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0))
