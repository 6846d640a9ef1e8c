"""Messages of the service about its fields, reworded for the options of the command line."""

import re
from collections.abc import Sequence

from fvs_schema.error_codes import FieldError

_OPTIONS = {
    "acceptance_radius_m": "--acceptance",
    "altitude_datum": "--altitudes",
    "battery_reserve": "--reserve",
    "battery_s": "--battery",
    "current_pose": "--current",
    "distance_m": "--distance",
    "expires_in_s": "--expires",
    "for_vehicle": "--for-vehicle",
    "geofence": "--geofence",
    "geoid_height_m": "--geoid",
    "gimbal_highest_deg": "HIGH of --gimbal",
    "gimbal_lowest_deg": "LOW of --gimbal",
    "highest_height_m": "--highest",
    "hold_s": "--hold",
    "home_above_takeoff_m": "--home-above-takeoff",
    "home_altitude_m": "ALT in --home LAT,LON,ALT",
    "home_latitude_deg": "--home",
    "home_longitude_deg": "--home",
    "leave_out": "--leave-out",
    "long_side_px": "--long-side",
    "lowest_height_m": "--lowest",
    "no_fly": "--no-fly",
    "radius_m": "--radius",
    "safety_m": "--safety",
    "snapshot_id": "--snapshot",
    "speed_m_s": "--speed",
    "test_every": "--test-every",
    "top_k": "--top",
    "transit_height_m": "--transit-height",
}
"""How the command line calls a field of a request."""
_COMMON_WORDS = frozenset({"geofence"})
"""Fields whose names are words of messages, too: they are fields only at the beginning of a message."""
_FIELD = re.compile(
    rf"(?<![\w.-])({'|'.join(name for name in _OPTIONS if name not in _COMMON_WORDS)})(?:=([\w-]+))?(?!\w)"
)
_FIRST = re.compile(rf"^`?({'|'.join(_COMMON_WORDS)})`?(?=:| must)")
_ENU_WORLD = "an enu world"
_DESCRIPTIONS = ("GET /openapi.json describes the request", "proto/fvs/v1 describes the request")


def in_options(text: str) -> str:
    """Replace the names of fields in a message or hint of the service by those of options."""
    text = _FIRST.sub(lambda found: _OPTIONS[found[1]], text)
    text = text.replace(_ENU_WORLD, f"{_ENU_WORLD} (`fvs-client scenes create --origin`)")
    return _FIELD.sub(_option, text)


def hint_in_options(hint: str, fields: Sequence[FieldError], command: str) -> str:
    """The hint; it refers to the help of ``command`` where that describes the invalid ``fields``.

    Fields inside of files are described by the service alone.
    """
    inside = any("." in field.field for field in fields)
    if hint.startswith(_DESCRIPTIONS) and not inside:
        return f"`{command} --help` describes the options."
    return in_options(hint)


def _option(found: re.Match[str]) -> str:
    option, value = _OPTIONS[found[1]], found[2]
    return option if value in (None, "true") else f"{option} {value}"
