"""Missions of Litchi, as CSV: https://www.litchiutilities.com/docs/litchiCsv.php.

The file has waypoints alone: heading mode, path mode and finish action are chosen in Litchi. At a view the
aircraft turns and tilts its camera by actions, which no heading mode overrides.
"""

import csv
import io
from itertools import pairwise

from fvs_schema.error_codes import FieldError
from fvs_schema.scenes import AltitudeDatum
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.flight import Mission, Waypoint
from fvs_service.missions.times import length_m

DATUMS = frozenset({AltitudeDatum.TAKEOFF})
_ACTIONS = 15
_HEADER = (
    *("latitude", "longitude", "altitude(m)", "heading(deg)", "curvesize(m)", "rotationdir", "gimbalmode"),
    "gimbalpitchangle",
    *(f"action{what}{number}" for number in range(1, _ACTIONS + 1) for what in ("type", "param")),
    *("altitudemode", "speed(m/s)", "poi_latitude", "poi_longitude", "poi_altitude(m)", "poi_altitudemode"),
    *("photo_timeinterval", "photo_distinterval"),
)
_NO_ACTION, _STAY, _PHOTOGRAPH, _ROTATE, _TILT = -1, 0, 1, 4, 5
_INTERPOLATED = 2
"""The gimbal turns on the way, from the pitch of one waypoint to that of the next."""
_OFF = -1
_SPEEDS_M_S = (0.1, 15.0)
_LONGEST_STAY_S = 32.0
_PITCHES_DEG = (-90.0, 30.0)
_HEIGHTS_M = (-200.0, 500.0)
_STEPS_M = (0.6, 1999.0)
"""DJI's SDK flies no shorter and no longer way between two waypoints.

https://forum.flylitchi.com/t/dji-sdk-limits-to-keep-in-mind-while-planing-a-mission/903
"""


def write(mission: Mission) -> bytes:
    """The mission as a table of waypoints; raises ``InvalidRequestError`` for what Litchi cannot fly."""
    _check(mission)
    table = io.StringIO()
    rows = csv.writer(table)
    rows.writerow(_HEADER)
    rows.writerows(_row(mission, waypoint) for waypoint in mission.waypoints)
    return table.getvalue().encode()


def _row(mission: Mission, waypoint: Waypoint) -> tuple[str | float, ...]:
    heading = round(waypoint.yaw_deg) % 360
    pitch = f"{waypoint.pitch_deg:.1f}"
    hold_ms = round(1000.0 * mission.options.hold_s)
    actions: list[tuple[str | float, str | float]] = []
    if waypoint.name is not None:
        actions = [(_ROTATE, heading), (_TILT, pitch), (_STAY, hold_ms), (_PHOTOGRAPH, 0)]
    actions += [(_NO_ACTION, 0)] * (_ACTIONS - len(actions))
    return (
        *(f"{waypoint.latitude_deg:.9f}", f"{waypoint.longitude_deg:.9f}", f"{waypoint.altitude_m:.2f}"),
        *(heading, 0, 0, _INTERPOLATED, pitch),
        *(value for action in actions for value in action),
        *(0, mission.options.speed_m_s),  # above the place of takeoff
        *(0, 0, 0, 0),  # no point of interest
        *(_OFF, _OFF),
    )


def _check(mission: Mission) -> None:
    options = mission.options
    _require_within("speed_m_s", options.speed_m_s, _SPEEDS_M_S)
    _require_within("hold_s", options.hold_s, (0.0, _LONGEST_STAY_S))
    for view in mission.views:
        if not _PITCHES_DEG[0] <= view.pitch_deg <= _PITCHES_DEG[1]:
            _refuse(f"{view.name} has a pitch of {view.pitch_deg:.1f}°; Litchi tilts by -90° to 30°")
    for waypoint in mission.waypoints:
        if not _HEIGHTS_M[0] <= waypoint.altitude_m <= _HEIGHTS_M[1]:
            _refuse(f"a waypoint is {waypoint.altitude_m:.0f} m above home; Litchi flies at -200 to 500 m")
    if len(mission.waypoints) < 2:
        _refuse("it has one waypoint, and Litchi flies two or more")
    for before, after in pairwise(mission.waypoints):
        step_m = length_m([before, after])
        if not _STEPS_M[0] <= step_m <= _STEPS_M[1]:
            names = " and ".join(point.name or "a waypoint to pass" for point in (before, after))
            _refuse(f"{names} are {step_m:.1f} m apart; Litchi flies 0.6 to 1999 m between waypoints")


def _require_within(name: str, value: float, limits: tuple[float, float]) -> None:
    low, high = limits
    if not low <= value <= high:
        raise InvalidRequestError(
            f"{name} is {value:g}; Litchi has {low:g} to {high:g}.",
            hint=f"Choose a {name} from {low:g} to {high:g}.",
            errors=[FieldError(name, f"it is not from {low:g} to {high:g}")],
        )


def _refuse(reason: str) -> None:
    raise InvalidRequestError(
        f"Litchi cannot fly this mission: {reason}.", hint="Choose other views, or another format."
    )
