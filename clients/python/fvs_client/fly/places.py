"""Distances between places on the ground."""

import math

from fvs_schema.fence import Place

_DEGREE_M = 111_195.0


def apart_m(first: Place, second: Place) -> float:
    """Distance in m of two latitudes and longitudes in degrees that are some kilometres apart."""
    north_m = (second[0] - first[0]) * _DEGREE_M
    degrees = (second[1] - first[1] + 180.0) % 360.0 - 180.0
    return math.hypot(north_m, degrees * _DEGREE_M * math.cos(math.radians(first[0])))
