"""Prediction of which views can be registered: their points were seen from a similar direction before.

Features are matched between directions up to some 30° apart. A view looks familiar where many sparse points
in its frame were seen from directions near its own, and a view that was planned makes others familiar: a
bridge. Calibrated by ``benchmarks/registration.py`` (docs/design/planning.md).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.plan.distances import even_sample
from fvs_engine.views import PinholeView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ANGLE_RAD = np.radians(15.0)
"""Angle between two directions to a point at which its features match with the weight 1/e."""
MOST_DISTANCE_RATIO = 2.0
"""Ratio of two distances to a point beyond which its features differ too much in size."""
ENOUGH = 62.0
"""Number of familiar points with which a view is registered in nine of ten cases."""
_LEAST, _SHARE_OF_MOST = 30.0, 0.6
"""In scenes of few points a share of the most familiar view's is enough; below 30 none was registered."""
EVEN_CHANCE, SLOPE = 38.0, 2.4
"""Logistic curve: familiar points with an even chance; steepness per unit of their logarithm."""
_MOST_POINTS = 4_000
_MOST_PRODUCTS = 20_000_000
_AT_ONCE = 2_000_000
_RELEVANT = 0.01


@dataclass(frozen=True, eq=False)
class Observations:
    """Sparse ``points`` [P, 3], and who saw them: point ``observed_point`` [O] from ``seen_from`` [O, 3]."""

    points: Array
    observed_point: NDArray[np.int64]
    seen_from: Array


class Familiarity:
    """The number of familiar points in the frame of each candidate, now and beside planned views.

    A point counts exp(−(a / ``ANGLE_RAD``)²), with the smallest angle a between the directions from the
    candidate and from a camera that saw it at no more than ``MOST_DISTANCE_RATIO`` times, and no less than
    that part of, the distance. Of very many points an even share stands for all. ``visible`` tells for each
    candidate which of the points [P, 3] in its frame nothing hides (None: all). Raises ``Cancelled``.
    """

    def __init__(
        self,
        observations: Observations,
        candidates: Sequence[PinholeView],
        monitor: Monitor | None = None,
        visible: Sequence[Callable[[Array], Mask]] | None = None,
    ) -> None:
        monitor = monitor or Monitor()
        most = min(_MOST_POINTS, _MOST_PRODUCTS // max(1, len(candidates)))
        used = even_sample(len(observations.points), most)
        self._share = len(used) / len(observations.points) if len(used) else 1.0
        self._points = observations.points[used]
        self._centres = np.array([view.centre for view in candidates]).reshape(-1, 3)
        numbers = np.full(len(observations.points), -1)
        numbers[used] = np.arange(len(used))
        seen_points = _SeenPoints(self._points, numbers[observations.observed_point], observations.seen_from)
        self._weights = np.zeros((len(candidates), len(used)), dtype=np.float32)
        for number, (weights, view) in enumerate(zip(self._weights, candidates, strict=True)):
            monitor.check()
            inside = _in_frame(view, self._points)
            if visible is not None:
                inside[inside] = visible[number](self._points[inside])
            weights[inside] = seen_points.weights(inside, view.centre)
        self.counts = self._weights.sum(axis=1, dtype=np.float64) / self._share
        """Familiar points in the frame of every candidate [n]."""
        self._most = float(self.counts.max(initial=0.0))
        self._enough = min(ENOUGH, max(_LEAST, _SHARE_OF_MOST * self._most))
        self._bridge = cache(self._uncached_bridge)

    @property
    def likely(self) -> Mask:
        """Which candidates [n] are familiar enough now."""
        return np.asarray(self.counts >= self._enough)

    def enough(self, plan: Sequence[int] = ()) -> Mask:
        """Which candidates [n] are familiar enough, beside the views of ``plan`` that are so themselves.

        If none is, the most familiar one, so that the plan can always continue.
        """
        if self._most < self._enough:
            return np.asarray(self.counts == self._most)
        mask = self.likely
        left = set(plan)
        while not mask.all() and (ready := {index for index in left if mask[index]}):
            for index in ready:
                mask = mask | self._bridge(index)
            left -= ready
        return mask

    def probability(self) -> Array:
        """The probability of being registered now, for every candidate [n]."""
        return np.asarray(1.0 / (1.0 + (EVEN_CHANCE / np.maximum(self.counts, 1e-9)) ** SLOPE))

    def _uncached_bridge(self, index: int) -> Mask:
        """Which candidates [n] are familiar enough once the candidate ``index`` was registered."""
        visible = np.flatnonzero(self._weights[index] > _RELEVANT)
        points, likely = self._points[visible], self._weights[index][visible]
        directions, lengths = _directions(points, self._centres[index])
        enough = self.likely
        unknown = np.flatnonzero(~enough)
        for part in np.array_split(unknown, -(-len(unknown) * max(1, len(visible)) // _AT_ONCE) or 1):
            now = self._weights[np.ix_(part, visible)]
            offsets = (points * directions).sum(axis=1) - self._centres[part] @ directions.T
            squares = (points**2).sum(axis=1) - 2 * self._centres[part] @ points.T
            others = np.sqrt(np.maximum(squares + (self._centres[part] ** 2).sum(axis=1)[:, None], 1e-24))
            near = _weight(np.where(_comparable(lengths, others), offsets / others, -1.0))
            # Only in the frame of a view, and only what the planned view adds to what is familiar anyway.
            gained = np.where(now > 0, np.maximum(likely * near - now, 0.0), 0.0).sum(axis=1)
            enough[part] = self.counts[part] + gained / self._share >= self._enough
        return np.asarray(enough)


class _SeenPoints:
    """Points [P, 3] with the directions and distances from which they were seen."""

    def __init__(self, points: Array, observed_point: NDArray[np.int64], seen_from: Array) -> None:
        order = np.argsort(observed_point, kind="stable")
        order = order[observed_point[order] >= 0]
        self._points = points
        self._observed = observed_point[order]
        self._directions, self._lengths = _directions(points[self._observed], seen_from[order])

    def weights(self, inside: Mask, centre: Array) -> Array:
        """The weights of the points ``inside`` [P] a frame, as seen from ``centre`` [3]."""
        found = np.zeros(len(self._points))
        kept = np.flatnonzero(inside[self._observed])
        if len(kept):
            observed = self._observed[kept]
            starts = np.flatnonzero(np.diff(observed, prepend=-1))
            directions, lengths = np.zeros((len(inside), 3)), np.zeros(len(inside))
            directions[inside], lengths[inside] = _directions(self._points[inside], centre)
            cosines = np.einsum("oi,oi->o", self._directions[kept], directions[observed])
            cosines[~_comparable(self._lengths[kept], lengths[observed])] = -1.0
            found[observed[starts]] = _weight(np.maximum.reduceat(cosines, starts))
        return found[inside]


def _in_frame(view: PinholeView, points: Array) -> Mask:
    camera, pose = view.camera, view.camera_from_model
    x, y, z = pose.rotation @ points.T + pose.translation[:, None]
    with np.errstate(divide="ignore", invalid="ignore"):
        u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
    return np.asarray((z > 0) & (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height))


def _directions(points: Array, seen_from: Array) -> tuple[Array, Array]:
    """Unit vectors [P, 3] to points, and their distances [P]."""
    offsets = points - seen_from
    lengths = np.sqrt(np.einsum("pi,pi->p", offsets, offsets))
    return offsets / np.maximum(lengths, 1e-12)[:, None], lengths


def _weight(cosines: Array) -> Array:
    """exp(−(angle / ANGLE_RAD)²) of two directions to a point."""
    return np.asarray(np.exp(-((np.arccos(np.clip(cosines, -1.0, 1.0)) / ANGLE_RAD) ** 2)))


def _comparable(lengths: Array, others: Array) -> Mask:
    """Whether two distances to a point are similar enough for its features to match."""
    near = lengths <= MOST_DISTANCE_RATIO * others
    return np.asarray(near & (others <= MOST_DISTANCE_RATIO * lengths))
