"""How long flights are, and how long they take."""

import math
from collections.abc import Sequence

import numpy as np
import pymap3d
from numpy.typing import NDArray

from fvs_service.missions.flight import Waypoint

TURN_S = 4.0
"""An ArduCopter turns by up to 180° in this time, at its 60°/s by default."""
SETTLE_S = 1.0
"""PX4 goes on when it has turned to within 12° (``MIS_YAW_ERR``): in this time the turn ends."""
AFTER_PHOTOGRAPH_S = 1.0
"""Time for which a camera is kept still after the command to take a photograph."""
LANDING_S = 20.0
"""An ArduCopter descends the last 10 m at 0.5 m/s."""
_UP_M_S, _DOWN_M_S = 2.5, 1.5
"""The vertical speeds of an ArduCopter by default."""
_STOP_S = 2.4
"""What braking and accelerating at a waypoint adds, at 1 m/s; it grows with the square root of the speed.

At 5 m/s it was 5.3 s for an ArduCopter, whose jerk is 1 m/s³ by default: 2√v s, and some to settle.
"""


def length_m(way: Sequence[Waypoint]) -> float:
    """The length of a straight way through waypoints, in three dimensions."""
    return float(np.linalg.norm(_steps_m(way), axis=1).sum())


def flying_s(way: Sequence[Waypoint], speed_m_s: float) -> float:
    """The time in which a multirotor flies a straight way through waypoints, and stops at each."""
    steps_m = _steps_m(way)
    rise_m = np.diff([point.altitude_m for point in way])
    level_m = np.sqrt(np.maximum(0.0, np.square(steps_m).sum(axis=1) - np.square(rise_m)))
    vertical_s = np.where(rise_m > 0.0, rise_m / _UP_M_S, -rise_m / _DOWN_M_S)
    stops_s = len(steps_m) * _STOP_S * math.sqrt(speed_m_s)
    return float(np.maximum(level_m / speed_m_s, vertical_s).sum()) + stops_s


def at_view_s(hold_s: float) -> float:
    """The time that a vehicle spends at a view: it turns, holds still and takes the photograph."""
    return TURN_S + hold_s + AFTER_PHOTOGRAPH_S


def _steps_m(way: Sequence[Waypoint]) -> NDArray[np.float64]:
    """The steps from waypoint to waypoint, [N-1, 3]."""
    places = np.array([(point.latitude_deg, point.longitude_deg, point.altitude_m) for point in way])
    return np.diff(np.stack(pymap3d.geodetic2ecef(*places.T), axis=1), axis=0)
