"""A table of all waypoints, as CSV (RFC 4180)."""

import csv
import io

from fvs_service.missions.flight import Mission

_HEADER = (
    "number",
    "id",
    "photograph",
    "latitude_deg",
    "longitude_deg",
    "altitude_m",
    "altitude_datum",
    "yaw_deg",
    "pitch_deg",
    "roll_deg",
    "speed_m_s",
    "acceptance_radius_m",
    "hold_s",
)


def write(mission: Mission) -> bytes:
    """The mission as a table: a row for each waypoint, with an empty id where none is photographed."""
    text = io.StringIO()
    rows = csv.writer(text)
    rows.writerow(_HEADER)
    options = mission.options
    for number, point in enumerate(mission.waypoints, start=1):
        is_view = point.name is not None
        rows.writerow(
            (
                number,
                point.name or "",
                int(is_view),
                f"{point.latitude_deg:.9f}",
                f"{point.longitude_deg:.9f}",
                f"{point.altitude_m:.4f}",
                mission.datum.value,
                *(f"{angle:.4f}" for angle in (point.yaw_deg, point.pitch_deg, point.roll_deg)),
                options.speed_m_s,
                options.acceptance_radius_m,
                options.hold_s if is_view else 0.0,
            )
        )
    return text.getvalue().encode()
