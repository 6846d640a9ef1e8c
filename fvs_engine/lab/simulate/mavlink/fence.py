"""ArduPilot's fence: a ceiling, a circle around home, polygons, circles; how far the vehicle is outside.

https://ardupilot.org/copter/docs/common-geofencing-landing-page.html
"""

import math
from collections.abc import Callable, Iterable, Iterator
from itertools import pairwise

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic
from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.mission import Item

_CEILING, _CIRCLE, _POLYGONS, _FLOOR = 1, 2, 4, 8
_NAMES = {_CEILING: "Max Alt", _CIRCLE: "Circle", _POLYGONS: "Polygon", _FLOOR: "Min Alt"}
_INSIDE = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
_OUTSIDE = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION


class Fence:
    """The fence of parameters and of ``items``."""

    def __init__(self, board: Board, items: Callable[[], list[Item]]) -> None:
        self._board, self._items = board, items

    @property
    def enabled(self) -> bool:
        """Whether it acts."""
        return self._board.parameters.named("FENCE_ENABLE") == 1.0

    def breaches(self) -> dict[str, float]:
        """The fences that the vehicle is outside of, and by how much in m."""
        if not self.enabled or self._board.state.home is None:
            return {}
        named = self._board.parameters.named
        kinds = int(named("FENCE_TYPE"))
        here = self._board.vehicle.believed
        off = here - self._board.state.home
        found = {
            _CEILING: float(off[2]) - named("FENCE_ALT_MAX"),
            _CIRCLE: float(np.hypot(*off[:2])) - named("FENCE_RADIUS"),
            _POLYGONS: self._outside_m(here[:2]),
        }
        return {_NAMES[kind]: over_m for kind, over_m in found.items() if kinds & kind and over_m > 0.0}

    def has(self, place: np.ndarray) -> bool:
        """Whether a place [3] is inside of the polygons and circles."""
        return self._outside_m(place[:2]) <= 0.0

    def count(self, _current: int | None = None) -> None:
        """Tell the number of items."""
        self._board.parameters.set("FENCE_TOTAL", float(len(self._items())))

    def _outside_m(self, here: np.ndarray) -> float:
        """The largest distance by which a polygon or a circle is breached; 0 when none is."""
        return max((self._breach_m(here, shape) for shape in self._shapes()), default=0.0)

    def _breach_m(self, here: np.ndarray, shape: list[Item]) -> float:
        places = [self._place(item) for item in shape]
        match shape[0].command:
            case mavlink.MAV_CMD_NAV_FENCE_CIRCLE_INCLUSION:
                return float(np.hypot(*(here - places[0]))) - shape[0].parameters[0]
            case mavlink.MAV_CMD_NAV_FENCE_CIRCLE_EXCLUSION:
                return shape[0].parameters[0] - float(np.hypot(*(here - places[0])))
            case command if command in (_INSIDE, _OUTSIDE):
                wanted = command == _INSIDE
                return _edge_m(here, places) if _contains(here, places) is not wanted else 0.0
        return 0.0

    def _shapes(self) -> Iterator[list[Item]]:
        """The items of each polygon and circle."""
        items, start = self._items(), 0
        while start < len(items):
            item = items[start]
            count = max(1, int(item.parameters[0])) if item.command in (_INSIDE, _OUTSIDE) else 1
            yield items[start : start + count]
            start += count

    def _place(self, item: Item) -> np.ndarray:
        origin = self._board.place.origin
        return np.asarray(enu_from_geodetic(GeodeticPosition(*item.degrees, origin.altitude_m), origin)[:2])


def fence_names(breaches: Iterable[str]) -> str:
    """ArduPilot's words for several fences."""
    *before, last = breaches
    names = f"{', '.join(before)} and {last}" if before else last
    return f"{names} fence{'s' if before else ''}"


def _contains(here: np.ndarray, corners: list[np.ndarray]) -> bool:
    inside = False
    for first, second in pairwise([*corners, corners[0]]):
        if (first[1] > here[1]) != (second[1] > here[1]):
            share = (here[1] - first[1]) / (second[1] - first[1])
            inside ^= bool(here[0] < first[0] + share * (second[0] - first[0]))
    return inside


def _edge_m(here: np.ndarray, corners: list[np.ndarray]) -> float:
    """Distance to the nearest edge."""
    nearest = math.inf
    for first, second in pairwise([*corners, corners[0]]):
        along = second - first
        share = float(np.clip((here - first) @ along / max(float(along @ along), 1e-9), 0.0, 1.0))
        nearest = min(nearest, float(np.hypot(*(here - first - share * along))))
    return nearest
