"""Geofences, without the service: polygons of latitudes and longitudes, also across the antimeridian."""

from itertools import pairwise

Place = tuple[float, float]
"""Latitude and longitude in degrees."""
_FEWEST = 3


class Fence:
    """A polygon to stay inside, of a text ``LAT,LON;LAT,LON;…``; raises ``ValueError`` for another text."""

    def __init__(self, text: str) -> None:
        corners: list[Place] = []
        for part in text.strip(";").split(";"):
            try:
                latitude_deg, longitude_deg = map(float, part.split(","))
            except ValueError:
                raise ValueError(f"{part[:40]!r} is not a LAT,LON.") from None
            if not (abs(latitude_deg) <= 90.0 and abs(longitude_deg) <= 180.0):
                raise ValueError(f"{part[:40]} is not on Earth.")
            corners.append((latitude_deg, longitude_deg))
        if len(corners) > 1 and corners[0] == corners[-1]:
            corners.pop()
        if len(corners) < _FEWEST:
            raise ValueError(f"A geofence has {_FEWEST} corners or more.")
        self._west_deg = corners[0][1]
        flat = [self._flat(corner) for corner in corners]
        self._edges = tuple(pairwise([*flat, flat[0]]))

    def has(self, place: Place) -> bool:
        """Whether a place is inside."""
        x, y = self._flat(place)
        crossed = sum(
            (a[1] > y) != (b[1] > y) and x < a[0] + (b[0] - a[0]) * (y - a[1]) / (b[1] - a[1])
            for a, b in self._edges
        )
        return crossed % 2 == 1

    def leaves(self, start: Place, end: Place) -> bool:
        """Whether the straight path between two places inside touches or crosses the fence."""
        p, q = self._flat(start), self._flat(end)
        return p != q and any(
            _side(p, q, a) * _side(p, q, b) <= 0 and _side(a, b, p) * _side(a, b, q) <= 0
            for a, b in self._edges
        )

    def _flat(self, place: Place) -> Place:
        """Degrees east of the first corner's meridian, and north of the equator."""
        return (place[1] - self._west_deg + 180.0) % 360.0 - 180.0, place[0]


def _side(a: Place, b: Place, point: Place) -> float:
    return (b[0] - a[0]) * (point[1] - a[1]) - (b[1] - a[1]) * (point[0] - a[0])
