"""Roll of views: a gimbal keeps the camera level."""

from dataclasses import replace

from fvs_service.missions.flight import Waypoint

_STRAIGHT_DOWN_DEG = 1.0
_LEVEL_DEG = 5.0


def levelled(point: Waypoint) -> Waypoint:
    """A view straight down, within 1°, with its roll as yaw, which turns its photograph alike.

    There the direction that yaw is measured from is hardly known, and a level view may have any roll.
    """
    if 90.0 + point.pitch_deg > _STRAIGHT_DOWN_DEG:
        return point
    return replace(point, yaw_deg=(point.yaw_deg + point.roll_deg) % 360.0, roll_deg=0.0)


def objection(view: Waypoint) -> str | None:
    """Why the roll of a view cannot be flown; None if it can."""
    if abs(view.roll_deg) <= _LEVEL_DEG:
        return None
    return f"it is rolled by {view.roll_deg:.1f}°, and a gimbal keeps level"
