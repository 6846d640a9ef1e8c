"""Upright boxes."""

from typing import Self

import numpy as np

from fvs_engine.geometry import SimilarityTransform, level_axes
from fvs_engine.plan.segments import inside_slab
from fvs_engine.plan.volumes.base import Array, BaseVolume, Mask, as_vector, moved_point, require_extent
from fvs_schema import volumes


class Box(BaseVolume, volumes.Box):
    """See ``fvs_schema.volumes.Box``."""

    def contains(self, points: Array) -> Mask:
        """See ``BaseVolume``."""
        return np.asarray((np.abs(self._local(points)) <= 0.5 * np.array(self.size)).all(axis=1))

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``BaseVolume``."""
        first, last = np.zeros(len(starts)), np.ones(len(starts))
        a, b = self._local(starts), self._local(ends)
        for axis, side in enumerate(self.size):
            enter, leave = inside_slab(a[:, axis], b[:, axis], -0.5 * side, 0.5 * side)
            first, last = np.maximum(first, enter), np.minimum(last, leave)
        return np.asarray(first <= last)

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``BaseVolume``."""
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "centre": moved_point(other_from_this, self.centre),
                "size": tuple(other_from_this.scale * side for side in self.size),
                "along": as_vector(other_from_this.rotation @ self._axes[:, 0]),
            }
        )

    def _check(self) -> None:
        require_extent("box", min(self.size), self.centre)
        if self.along is not None:
            level = level_axes(self.up)[:, :2].T @ np.array(self.along)
            if np.linalg.norm(level) <= 1e-6 * np.linalg.norm(self.along):
                raise ValueError("The first side of a box cannot point up; `along` is a level direction.")

    def _at(self, units: Array) -> Array:
        local = (units - 0.5) * np.array(self.size)
        return np.asarray(self.centre + local @ self._axes.T)

    @property
    def _axes(self) -> Array:
        axes = level_axes(self.up)
        if self.along is None:
            return axes
        x = axes[:, :2] @ (axes[:, :2].T @ np.array(self.along))
        x /= np.linalg.norm(x)
        return np.column_stack([x, np.cross(axes[:, 2], x), axes[:, 2]])

    def _local(self, points: Array) -> Array:
        return np.asarray((points - np.array(self.centre)) @ self._axes)
