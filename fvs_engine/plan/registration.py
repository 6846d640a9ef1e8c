"""Which views can be registered: whether features in sight were seen from a similar direction before.

Features are matched between directions up to some 30° apart. A view looks familiar where many sparse points
in its frame were seen from directions near its own, and a view that was planned makes others familiar: a
bridge. Calibrated by ``benchmarks/registration.py`` (docs/adr/0031).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from fvs_engine.views import PinholeView

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]

ANGLE_RAD = np.radians(15.0)
"""Angle between two directions to a point at which its features match with the weight 1/e."""
MOST_DISTANCE_RATIO = 2.0
"""Ratio of two distances to a point beyond which its features differ too much in size."""
ENOUGH = 62.0
"""Familiar points of a view that is registered in nine of ten cases."""
_HALF, _SLOPE = 38.0, 2.4
"""Of the logistic curve: familiar points with an even chance; its steepness per unit of their logarithm."""
_MOST_POINTS = 4_000
_MOST_PRODUCTS = 20_000_000
_RELEVANT = 0.01


@dataclass(frozen=True, eq=False)
class Observations:
    """Sparse ``points`` [P, 3], and who saw them: point ``observed_point`` [O] from ``seen_from`` [O, 3]."""

    points: Array
    observed_point: NDArray[np.int64]
    seen_from: Array


class Familiarity:
    """How many points in the frame of each candidate are familiar, now and beside planned views.

    A point counts exp(−(a / ``ANGLE_RAD``)²), with the smallest angle a between the directions from the
    candidate and from a camera that saw it at no more than ``MOST_DISTANCE_RATIO`` times, and no less than
    that part of, the distance. Of very many points an even share stands for all.
    """

    def __init__(self, observations: Observations, candidates: Sequence[PinholeView]) -> None:
        most = min(_MOST_POINTS, _MOST_PRODUCTS // max(1, len(candidates)))
        used, self._share = _share(len(observations.points), most)
        self._points = observations.points[used]
        self._centres = np.array([view.centre for view in candidates]).reshape(-1, 3)
        number = np.full(len(observations.points), -1)
        number[used] = np.arange(len(used))
        numbers = number[observations.observed_point]
        order = np.argsort(numbers, kind="stable")
        order = order[numbers[order] >= 0]
        seen_from, numbers = observations.seen_from[order], numbers[order]
        seen = [self._seen(view, seen_from, numbers) for view in candidates]
        self._weights = np.array(seen).reshape(len(candidates), len(used))
        self.counts = self._weights.sum(axis=1) / self._share
        """Familiar points in the frame of every candidate [n]."""
        self._bridge = cache(self._uncached_bridge)

    def enough(self, plan: Sequence[int] = ()) -> Mask:
        """Which candidates [n] are familiar enough, beside the views of ``plan`` that are so themselves.

        Where none is, the most familiar one, so that there is always a way on.
        """
        if len(self.counts) and self.counts.max() < ENOUGH:
            return np.asarray(self.counts == self.counts.max())
        mask = np.asarray(self.counts >= ENOUGH)
        left = set(plan)
        while ready := {index for index in left if mask[index]}:
            for index in ready:
                mask = mask | (self._bridge(index) >= ENOUGH)
            left -= ready
        return mask

    def probability(self) -> Array:
        """Of being registered now, for every candidate [n]."""
        return np.asarray(1.0 / (1.0 + (_HALF / np.maximum(self.counts, 1e-9)) ** _SLOPE))

    def _seen(self, view: PinholeView, seen_from: Array, numbers: NDArray[np.int64]) -> Array:
        """The weight [P] of every point for a view; 0 outside of its frame."""
        weights = np.zeros(len(self._points))
        camera = view.camera
        pose = view.camera_from_model
        x, y, z = pose.rotation @ self._points.T + pose.translation[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            u, v = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
            inside = (z > 0) & (u >= 0) & (u <= camera.width) & (v >= 0) & (v <= camera.height)
        kept = inside[numbers]
        observed = numbers[kept]
        if len(observed):
            angles = _weights(self._points[observed], seen_from[kept], view.centre)
            np.maximum.at(weights, observed, angles)
        return weights

    def _uncached_bridge(self, index: int) -> Array:
        """Points of every candidate [n] that are familiar once the candidate ``index`` was registered."""
        visible = np.flatnonzero(self._weights[index] > _RELEVANT)
        now = self._weights[:, visible]
        near = _weights(self._points[visible], self._centres[index], self._centres[:, None])
        # Only in the frame of a view, and only what the planned view adds to what is familiar anyway.
        gained = np.where(now > 0, np.maximum(self._weights[index][visible] * near - now, 0.0), 0.0)
        return np.asarray((self._weights.sum(axis=1) + gained.sum(axis=1)) / self._share)


def _weights(points: Array, seen_from: Array, centre: Array) -> Array:
    """exp(−(angle / ANGLE_RAD)²) between the directions to points; 0 where the distances differ too much.

    ``points`` [P, 3], ``seen_from`` and ``centre`` broadcast; the result lacks their last axis.
    """
    first, second = points - seen_from, points - centre
    lengths, others = np.linalg.norm(first, axis=-1), np.linalg.norm(second, axis=-1)
    cosines = np.einsum("...i,...i->...", first, second) / np.maximum(lengths * others, 1e-12)
    angles = np.arccos(np.clip(cosines, -1.0, 1.0))
    comparable = (lengths <= MOST_DISTANCE_RATIO * others) & (others <= MOST_DISTANCE_RATIO * lengths)
    return np.asarray(np.where(comparable, np.exp(-((angles / ANGLE_RAD) ** 2)), 0.0))


def _share(count: int, most: int) -> tuple[NDArray[np.int64], float]:
    """Indices of at most ``most`` of ``count``, drawn evenly and always the same, and their share."""
    if count <= most:
        return np.arange(count), 1.0
    return np.sort(np.random.default_rng(0).choice(count, most, replace=False)), most / count
