"""Roll of views: a gimbal keeps the camera level."""

import math
from dataclasses import replace

from fvs_service.missions.flight import Waypoint

_LEVEL_DEG = 5.0


def levelled(point: Waypoint) -> Waypoint:
    """Fly the roll of a view within 5° of straight down as yaw, which turns its photograph the same way.

    There the direction that yaw is measured from is hardly known, and a level view may have any roll: so have
    estimated poses of photographs that were taken straight down. What is left of the tilt is flown as pitch.
    """
    tilt_deg = 90.0 + point.pitch_deg
    if tilt_deg > _LEVEL_DEG:
        return point
    along_deg = max(0.0, tilt_deg * math.cos(math.radians(point.roll_deg)))
    yaw_deg = (point.yaw_deg + point.roll_deg) % 360.0
    return replace(point, yaw_deg=yaw_deg, pitch_deg=along_deg - 90.0, roll_deg=0.0)


def objection(view: Waypoint) -> str | None:
    """Why the roll of a view cannot be flown; None if it can."""
    if abs(view.roll_deg) <= _LEVEL_DEG:
        return None
    return f"it is rolled by {view.roll_deg:.1f}°, and a gimbal keeps level"
