"""Corridors along a path."""

from typing import Self

import numpy as np

from fvs_engine.geometry import SimilarityTransform, level_axes
from fvs_engine.plan.segments import boxes_meet, nearest_segment, segments_distance
from fvs_engine.plan.volumes.base import Array, BaseVolume, Mask, moved_point, require_extent
from fvs_schema import volumes
from fvs_schema.volumes import UP


class Corridor(BaseVolume, volumes.Corridor):
    """See ``fvs_schema.volumes.Corridor``."""

    def contains(self, points: Array) -> Mask:
        """See ``BaseVolume``."""
        _, distances = nearest_segment(points, *self._edges)
        return np.asarray(distances <= self.radius)

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``BaseVolume``."""
        mask = np.zeros(len(starts), dtype=np.bool_)
        for one, other in zip(*self._edges, strict=True):
            left = np.flatnonzero(~mask)
            lower, upper = np.minimum(one, other) - self.radius, np.maximum(one, other) + self.radius
            left = left[boxes_meet(starts[left], ends[left], lower, upper)]
            pair = np.broadcast_to(one, (len(left), 3)), np.broadcast_to(other, (len(left), 3))
            mask[left] = segments_distance(starts[left], ends[left], *pair) <= self.radius
        return mask

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``BaseVolume``."""
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "path": tuple(moved_point(other_from_this, corner) for corner in self.path),
                "radius": other_from_this.scale * self.radius,
            }
        )

    def _check(self) -> None:
        for corner in self.path:
            require_extent("corridor", self.radius, corner)

    def _at(self, units: Array) -> Array:
        """In a box around each edge: a point counts only in the box of the edge that is nearest to it."""
        starts, ends = self._edges
        lengths = np.linalg.norm(ends - starts, axis=1)
        sizes = lengths + 2.0 * self.radius
        limits = np.cumsum(sizes)
        along = units[:, 0] * limits[-1]
        number = np.minimum(np.searchsorted(limits, along, side="right"), len(sizes) - 1)
        along -= limits[number] - sizes[number] + self.radius
        # An edge without length has no direction: any serves for its ball.
        axes = np.stack(
            [level_axes(e - s if (e != s).any() else UP) for s, e in zip(starts, ends, strict=True)]
        )
        local = np.column_stack([self.radius * (2.0 * units[:, 1:] - 1.0), along])
        points = starts[number] + np.einsum("nij,nj->ni", axes[number], local)
        nearest, _ = nearest_segment(points, starts, ends)
        return np.asarray(points[nearest == number])

    @property
    def _edges(self) -> tuple[Array, Array]:
        path = np.array(self.path)
        return path[:-1], path[1:]
