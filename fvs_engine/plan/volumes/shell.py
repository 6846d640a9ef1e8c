"""Shells around an object."""

from typing import Self

import numpy as np

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.plan.segments import inside_ball, inside_slab
from fvs_engine.plan.volumes.base import Array, BaseVolume, Mask, moved_point, require_extent
from fvs_schema import volumes


class Shell(BaseVolume, volumes.Shell):
    """See ``fvs_schema.volumes.Shell``."""

    def contains(self, points: Array) -> Mask:
        """See ``BaseVolume``."""
        local = self._local(points)
        distances = np.linalg.norm(local, axis=1)
        return np.asarray(
            (distances >= self.inner) & (distances <= self.outer) & (local[:, 2] >= self._lowest)
        )

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``BaseVolume``."""
        a, b = self._local(starts), self._local(ends)
        first, last = inside_ball(a, b, self.outer)
        enter, leave = inside_slab(a[:, 2], b[:, 2], self._lowest, self.outer)
        first, last = np.maximum(first, enter), np.minimum(last, leave)
        mask = np.asarray(first <= last)
        a, b, first, last = a[mask], b[mask], first[mask, None], last[mask, None]
        # The distance from the centre is largest at one of the ends of what is inside the outer ball.
        farthest = np.maximum(
            np.linalg.norm(a + first * (b - a), axis=1), np.linalg.norm(a + last * (b - a), axis=1)
        )
        mask[mask] = farthest >= self.inner
        return mask

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``BaseVolume``."""
        scale = other_from_this.scale
        return self.model_validate(
            {
                "up": self._turned(other_from_this),
                "centre": moved_point(other_from_this, self.centre),
                "inner": scale * self.inner,
                "outer": scale * self.outer,
                "above": None if self.above is None else scale * self.above,
            }
        )

    def _check(self) -> None:
        if self.inner >= self.outer:
            raise ValueError(
                f"A shell needs a thickness: its inner radius, {self.inner:g}, is not under its outer, "
                f"{self.outer:g}."
            )
        if self.above is not None and self.above >= self.outer:
            raise ValueError(f"Nothing of a shell of radius {self.outer:g} is above {self.above:g}.")
        require_extent("shell", min(self.outer - self.inner, self.outer - self._lowest), self.centre)

    def _at(self, units: Array) -> Array:
        cubes = self.inner**3 + units[:, 0] * (self.outer**3 - self.inner**3)
        radii, angles = np.cbrt(cubes), 2.0 * np.pi * units[:, 1]
        z = 1.0 - units[:, 2] * (1.0 - max(-1.0, self._lowest / self.outer))
        ring = np.sqrt(1.0 - z**2)
        directions = np.column_stack([ring * np.cos(angles), ring * np.sin(angles), z])
        return np.asarray(self.centre + radii[:, None] * directions @ self._axes.T)

    @property
    def _lowest(self) -> float:
        return -self.outer if self.above is None else max(-self.outer, self.above)

    def _local(self, points: Array) -> Array:
        return np.asarray((points - np.array(self.centre)) @ self._axes)
