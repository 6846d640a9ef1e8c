"""Places on the ground, home among them, and the distances between them."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from fvs_schema.fence import Place

_DEGREE_M = 111_195.0


@dataclass(frozen=True)
class Home:
    """Home as the autopilot has it (``HOME_POSITION``); the altitude is above sea level."""

    latitude_deg: float
    longitude_deg: float
    altitude_m: float

    @property
    def place(self) -> Place:
        """Latitude and longitude."""
        return self.latitude_deg, self.longitude_deg

    def moved_m(self, other: "Home") -> float:
        """The distance of another home, with that in altitude."""
        return math.hypot(apart_m(self.place, other.place), other.altitude_m - self.altitude_m)


def apart_m(first: Place, second: Place) -> float:
    """Distance in m of two latitudes and longitudes in degrees that are some kilometres apart."""
    return abs(_from(first, second))


def off_m(here: Place, way: Sequence[Place]) -> float:
    """Distance in m from a way of straight lines through two places or more."""
    return min(_to_line_m(_from(here, start), _from(here, end)) for start, end in pairwise(way))


def _from(first: Place, second: Place) -> complex:
    """The way from one place to another in m, towards the north and, imaginary, the east."""
    north_m = (second[0] - first[0]) * _DEGREE_M
    degrees = (second[1] - first[1] + 180.0) % 360.0 - 180.0
    return complex(north_m, degrees * _DEGREE_M * math.cos(math.radians(first[0])))


def _to_line_m(start: complex, end: complex) -> float:
    """Distance of the origin from a line between two points."""
    along = end - start
    share = -(start * along.conjugate()).real / abs(along) ** 2 if along else 0.0
    return abs(start + min(1.0, max(0.0, share)) * along)
