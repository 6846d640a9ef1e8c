"""The surface of a model, by its sparse points: even places of it, and a view that looks at each."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.plan.distances import even_sample
from fvs_engine.plan.familiarity import Observations

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

_MOST_POINTS = 200_000
_MOST_POINTS = 200_000
_STEPS = 12
"""Halvings of the range of voxel sizes, on a scale of logarithms."""
_CELLS = 2**20
"""Of the finest grid along each axis."""


@dataclass(frozen=True, eq=False)
class Surface:
    """``places`` [S, 3] of a surface, and for each the ``view`` [S, 6] that looks straight at it.

    A view is a camera centre and a unit viewing direction. It is on the side of the images that see the
    place, in their mean direction from it and at their mean distance: normals of sparse points are less
    reliable (docs/design/planning.md).
    """

    places: Array
    views: Array

    def view_points(self, spread: float) -> Array:
        """Points [S, 6] of the views, as ``fvs_engine.plan.distances.view_points`` has them."""
        scale = np.array([1.0 / spread if spread > 0 else 0.0] * 3 + [1.0] * 3)
        return np.asarray(self.views * scale)


def surface_of(observations: Observations, count: int) -> Surface:
    """At most ``count`` places, evenly over the sparse points: the mean of those in each voxel of a grid.

    A place is seen by all images that see one of its points. Of very many points an even share is used.
    """
    used = even_sample(len(observations.points), _MOST_POINTS)
    points, numbers = observations.points[used], np.full(len(observations.points), -1)
    cells = numbers[used] = _cells(points, count)
    cell = numbers[observations.observed_point]
    offsets = observations.seen_from - observations.points[observations.observed_point]
    lengths = np.sqrt(np.einsum("oi,oi->o", offsets, offsets))
    seen = (cell >= 0) & (lengths > 0)
    cell, offsets, lengths = cell[seen], offsets[seen], lengths[seen]
    places = _means(cells, points, np.bincount(cells))
    number = np.bincount(cell, minlength=len(places))
    towards = _means(cell, offsets / lengths[:, None], number)
    distances = _means(cell, lengths[:, None], number)
    norms = np.linalg.norm(towards, axis=1, keepdims=True)
    kept = norms[:, 0] > 0
    places, towards = places[kept], towards[kept] / norms[kept]
    return Surface(places, np.concatenate([places + distances[kept] * towards, -towards], axis=1))


def _cells(points: Array, count: int) -> Indices:
    """The voxel [P] of each point, numbered from 0: of the smallest voxels that are at most ``count``."""
    if len(points) <= count:
        return np.arange(len(points))
    offsets = points - points.min(axis=0)
    large = 2.0 * float(offsets.max())
    if not large:
        return np.zeros(len(points), dtype=np.int64)
    small = large / _CELLS
    for _ in range(_STEPS):
        size = float(np.sqrt(small * large))
        if len(np.unique(_keys(offsets, size))) > count:
            small = size
        else:
            large = size
    return np.asarray(np.unique(_keys(offsets, large), return_inverse=True)[1], dtype=np.int64)


def _keys(offsets: Array, size: float) -> Indices:
    """One number for each voxel."""
    x, y, z = (offsets / size).astype(np.int64).T
    return np.asarray((x * _CELLS + y) * _CELLS + z)


def _means(cells: Indices, values: Array, number: Indices) -> Array:
    """The mean [S, n] of the values [·, n] of each cell; 0 without any."""
    sums = [np.bincount(cells, column, len(number)) for column in values.T]
    return np.asarray(np.stack(sums, axis=1) / np.maximum(number, 1)[:, None])
