"""Upright cylinders."""

from typing import Self

import numpy as np

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.plan.segments import inside_ball, inside_slab
from fvs_engine.plan.volumes.base import Array, BaseVolume, Mask, moved_point, require_extent
from fvs_schema import volumes


class Cylinder(BaseVolume, volumes.Cylinder):
    """See ``fvs_schema.volumes.Cylinder``."""

    def contains(self, points: Array) -> Mask:
        """See ``BaseVolume``."""
        local = self._local(points)
        height = local[:, 2]
        within = np.hypot(local[:, 0], local[:, 1]) <= self.radius
        return np.asarray(within & (height >= 0.0) & (height <= self.height))

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``BaseVolume``."""
        a, b = self._local(starts), self._local(ends)
        first, last = inside_ball(a[:, :2], b[:, :2], self.radius)
        enter, leave = inside_slab(a[:, 2], b[:, 2], 0.0, self.height)
        return np.asarray(np.maximum(first, enter) <= np.minimum(last, leave))

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``BaseVolume``."""
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "base": moved_point(other_from_this, self.base),
                "radius": other_from_this.scale * self.radius,
                "height": other_from_this.scale * self.height,
            }
        )

    def _check(self) -> None:
        require_extent("cylinder", min(self.radius, self.height), self.base)

    def _at(self, units: Array) -> Array:
        radii, angles = self.radius * np.sqrt(units[:, 0]), 2.0 * np.pi * units[:, 1]
        local = np.column_stack([radii * np.cos(angles), radii * np.sin(angles), self.height * units[:, 2]])
        return np.asarray(self.base + local @ self._axes.T)

    def _local(self, points: Array) -> Array:
        return np.asarray((points - np.array(self.base)) @ self._axes)
