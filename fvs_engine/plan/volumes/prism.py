"""Polygons between two heights."""

from typing import Self

import numpy as np

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.plan.segments import inside_slab, polygon_contains, polygon_crossed, segments_distance
from fvs_engine.plan.volumes.base import LEAST_EXTENT, Array, BaseVolume, Mask, moved_point, require_extent
from fvs_schema import volumes


class Prism(BaseVolume, volumes.Prism):
    """See ``fvs_schema.volumes.Prism``."""

    def contains(self, points: Array) -> Mask:
        """See ``BaseVolume``."""
        local = points @ self._axes
        height = local[:, 2]
        mask = (height >= self.lower) & (height <= self.upper)
        mask[mask] = polygon_contains(self._polygon, local[mask, :2])
        return np.asarray(mask)

    def crossed(self, starts: Array, ends: Array) -> Mask:
        """See ``BaseVolume``."""
        a, b = starts @ self._axes, ends @ self._axes
        enter, leave = inside_slab(a[:, 2], b[:, 2], self.lower, self.upper)
        mask = np.asarray(enter <= leave)
        a, b = a[mask, :2], b[mask, :2]
        enter, leave = enter[mask, None], leave[mask, None]
        mask[mask] = polygon_crossed(self._polygon, a + enter * (b - a), a + leave * (b - a))
        return mask

    def moved(self, other_from_this: SimilarityTransform) -> Self:
        """See ``BaseVolume``."""
        up = self._turned(other_from_this)
        offset = float(other_from_this.translation @ np.array(up)) / float(np.linalg.norm(up))
        return self.model_validate(
            {
                "up": up,
                "corners": tuple(moved_point(other_from_this, corner) for corner in self.corners),
                "lower": other_from_this.scale * self.lower + offset,
                "upper": other_from_this.scale * self.upper + offset,
            }
        )

    def _check(self) -> None:
        if self.lower >= self.upper:
            raise ValueError(
                f"A prism needs a height: its lower end, {self.lower:g}, is not under its upper, "
                f"{self.upper:g}."
            )
        require_extent("prism", self.upper - self.lower, (self.lower, self.upper, 0.0))
        polygon = self._polygon
        count = len(polygon)
        following = np.roll(polygon, -1, axis=0)
        if (np.linalg.norm(following - polygon, axis=1) <= LEAST_EXTENT * np.abs(polygon).max()).any():
            raise ValueError("Two corners of the polygon that follow each other are the same; leave one out.")
        centred = polygon - polygon.mean(axis=0)
        after = np.roll(centred, -1, axis=0)
        area = 0.5 * abs(float((centred[:, 0] * after[:, 1] - centred[:, 1] * after[:, 0]).sum()))
        for number in range(count - 2):
            others = np.arange(number + 2, count - (number == 0))
            starts = np.broadcast_to(polygon[number], (len(others), 2))
            ends = np.broadcast_to(following[number], (len(others), 2))
            met = segments_distance(starts, ends, polygon[others], following[others]) == 0.0
            if met.any():
                raise ValueError(
                    f"The polygon crosses itself: its edges {number + 1} and {others[met][0] + 1} meet. "
                    "Give its corners in order around it."
                )
        if area <= LEAST_EXTENT * np.ptp(polygon, axis=0).max() ** 2:
            raise ValueError("The corners of the polygon are on a line: it has no area.")

    def _at(self, units: Array) -> Array:
        low, high = self._polygon.min(axis=0), self._polygon.max(axis=0)
        lower, upper = np.array([*low, self.lower]), np.array([*high, self.upper])
        return np.asarray((lower + units * (upper - lower)) @ self._axes.T)

    @property
    def _polygon(self) -> Array:
        return np.asarray(np.array(self.corners) @ self._axes[:, :2])
