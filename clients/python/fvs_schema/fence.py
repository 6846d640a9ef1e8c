"""Geofences: polygons of latitudes and longitudes, also across the antimeridian. Imports nothing heavy."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Self

Place = tuple[float, float]
"""Latitude and longitude in degrees."""

MOST_CORNERS = 200


class Fence:
    """A polygon that vehicles stay inside; not for polygons around a pole, or wider than half the Earth."""

    def __init__(self, corners: Sequence[Place]) -> None:
        self.corners = tuple(corners)
        self._west_deg = self.corners[0][1]
        flat = [self._flat(corner) for corner in self.corners]
        self._edges = tuple(pairwise([*flat, flat[0]]))

    @classmethod
    def parse(cls, text: str) -> Self:
        """The fence of ``latitude,longitude;latitude,longitude;…``; raises ``ValueError``."""
        corners = []
        for part in text.strip(";").split(";"):
            try:
                latitude_deg, longitude_deg = map(float, part.split(","))
            except ValueError:
                raise ValueError(f"{part[:40]!r} is not a latitude,longitude") from None
            if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
                raise ValueError(f"{part[:40]} is not on Earth")
            corners.append((latitude_deg, longitude_deg))
        if len(corners) > 1 and corners[0] == corners[-1]:
            corners.pop()
        if not 3 <= len(corners) <= MOST_CORNERS:
            raise ValueError(f"a fence has 3 to {MOST_CORNERS} corners, and this one has {len(corners)}")
        return cls(corners)

    def has(self, position: Place) -> bool:
        """Whether a position is inside."""
        return self._has(self._flat(position))

    def crosses(self, start: Place, end: Place) -> bool:
        """Whether the straight path between two positions inside leaves the fence.

        It may touch the fence, and run along an edge.
        """
        p, q = self._flat(start), self._flat(end)
        touched, along = {0.0, 1.0}, []
        touches = False
        for a, b in self._edges:
            left_a, left_b = _side(p, q, a), _side(p, q, b)
            if left_a * left_b > 0 or p == q:
                continue
            from_edge = _side(a, b, p) * _side(a, b, q)
            if left_a * left_b < 0 and from_edge < 0:
                return True
            ends = [_share(p, q, corner) for corner, left in ((a, left_a), (b, left_b)) if left == 0]
            touched.update(share for share in ends if 0.0 < share < 1.0)
            touches |= from_edge == 0 or bool(ends)
            if len(ends) == 2:
                along.append((min(ends), max(ends)))
        # Where it only touches, it is inside or outside from one corner to the next.
        return touches and any(
            not any(low <= middle <= high for low, high in along)
            and not self._has((p[0] + middle * (q[0] - p[0]), p[1] + middle * (q[1] - p[1])))
            for middle in ((before + after) / 2.0 for before, after in pairwise(sorted(touched)))
        )

    def _has(self, flat: Place) -> bool:
        x, y = flat
        crossed = sum(
            (a[1] > y) != (b[1] > y) and x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1])
            for a, b in self._edges
        )
        return crossed % 2 == 1

    def _flat(self, position: Place) -> Place:
        """The position in degrees east and north of the first corner's meridian and the equator."""
        latitude_deg, longitude_deg = position
        return (longitude_deg - self._west_deg + 180.0) % 360.0 - 180.0, latitude_deg


def _share(p: Place, q: Place, point: Place) -> float:
    """Parameter, 0 to 1, of a point on the segment from ``p`` to ``q``."""
    axis = 0 if abs(q[0] - p[0]) > abs(q[1] - p[1]) else 1
    return (point[axis] - p[axis]) / (q[axis] - p[axis])


def _side(a: Place, b: Place, point: Place) -> float:
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])
