"""Geofences: polygons of latitudes and longitudes, also across the antimeridian."""

from collections.abc import Sequence
from itertools import pairwise
from typing import TypeAlias

Corner: TypeAlias = tuple[float, float]
"""Latitude and longitude in degrees."""


class Fence:
    """A polygon that vehicles stay inside; not for polygons around a pole, or wider than half the Earth."""

    def __init__(self, corners: Sequence[Corner]) -> None:
        self.corners = tuple(corners)
        self._west_deg = self.corners[0][1]
        flat = [self._flat(corner) for corner in self.corners]
        self._edges = tuple(pairwise([*flat, flat[0]]))

    def has(self, position: Corner) -> bool:
        """Whether a position is inside."""
        x, y = self._flat(position)
        crossed = sum(
            (a[1] > y) != (b[1] > y) and x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1])
            for a, b in self._edges
        )
        return crossed % 2 == 1

    def crosses(self, start: Corner, end: Corner) -> bool:
        """Whether the straight way between two positions crosses the fence."""
        p, q = self._flat(start), self._flat(end)
        return any(
            _side(p, q, a) * _side(p, q, b) < 0 and _side(a, b, p) * _side(a, b, q) < 0
            for a, b in self._edges
        )

    def _flat(self, position: Corner) -> Corner:
        """The position in degrees east and north of the first corner's meridian and the equator."""
        latitude_deg, longitude_deg = position
        return (longitude_deg - self._west_deg + 180.0) % 360.0 - 180.0, latitude_deg


def _side(a: Corner, b: Corner, point: Corner) -> float:
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])
