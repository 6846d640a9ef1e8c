"""The vehicle's own failsafes and fence, as its parameters say; lines of the checklist.

The actions are those of ArduCopter's and PX4's parameter references:
https://ardupilot.org/copter/docs/parameters.html, https://docs.px4.io/main/en/advanced_config/parameter_reference.html
(``commander_params.yaml``, ``geofence_params.yaml``, ``mission_params.yaml`` and others).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

from fvs_client.fly.link import SYSTEM
from fvs_client.fly.own_fence import OwnFence
from fvs_schema.fence import Fence

_GCS_ACTIONS = (
    "off",
    "RTL",
    "RTL",
    "SmartRTL, else RTL",
    "SmartRTL, else LAND",
    "LAND",
    "DO_LAND_START, else RTL",
    "BRAKE, else LAND",
)
_REMOTE_ACTIONS = ("off", "RTL", "RTL", "LAND", *_GCS_ACTIONS[3:5], *_GCS_ACTIONS[6:])
_LINK_ACTIONS = ("off", "hold", "return", "land", "off", "terminate", "disarm")
_BATTERY_ACTIONS = ("warning only", "LAND", "RTL", *_GCS_ACTIONS[3:5], "terminate", *_GCS_ACTIONS[6:])
_LOW_BATTERY_ACTIONS = ("warning only", "return", "land", "return, then land")
_FENCE_ACTIONS = (
    "report only",
    "RTL, else LAND",
    "LAND",
    "SmartRTL, else RTL or LAND",
    "BRAKE, else LAND",
    "SmartRTL, else LAND",
)
_BRINGS_DOWN, _FENCE_BRINGS_DOWN = (2, 3), (3, 5)
"""Those of PX4's ``_LINK_ACTIONS`` and ``_GEOFENCE_ACTIONS`` that return or land."""
_TRIGGERS = ("off", "on command", "always, by time", "always, by distance", "on command")
_GEOFENCE_ACTIONS = ("off", "warning only", "hold", "return", "terminate", "land")
_CONTINUES_MISSION = 2
"""Bit of ``FS_OPTIONS``."""
_EXCEPT_MISSIONS = 1
"""Bit of ``COM_DLL_EXCEPT``."""
_ON_ARMING = 3
"""``FENCE_AUTOENABLE``: on at arming. Its 1 and 2 switch it on after takeoffs in GUIDED alone."""
_CEILING, _CIRCLE, _POLYGONS = 1, 2, 4
"""Bits of ``FENCE_TYPE``."""
_LOW_CEILING_M = 10.0
"""A fence ceiling more than this above ``--highest`` is pointed out."""
ARDUPILOT = (
    "ARMING_CHECK",
    "ARMING_SKIPCHK",  # from 4.7 on
    "BATT_FS_CRT_ACT",
    "BATT_FS_LOW_ACT",
    "BATT_LOW_MAH",
    "BATT_LOW_VOLT",
    "BATT_MONITOR",
    "FENCE_ACTION",
    "FENCE_ALT_MAX",
    "FENCE_AUTOENABLE",
    "FENCE_ENABLE",
    "FENCE_RADIUS",
    "FENCE_TYPE",
    "FS_GCS_ENABLE",
    "FS_OPTIONS",
    "FS_THR_ENABLE",
    "MAV_GCS_SYSID",  # from 4.7 on
    "MAV_GCS_SYSID_HI",
    "RTL_ALT",
    "RTL_ALT_FINAL",
    "RTL_ALT_FINAL_M",  # from 4.7 on
    "RTL_ALT_M",
    "RTL_ALT_TYPE",
    "RTL_CONE_SLOPE",
    "SYSID_MYGCS",
)
PX4 = (
    "BAT_CRIT_THR",
    "COM_DLL_EXCEPT",  # of later versions
    "COM_LOW_BAT_ACT",
    "GF_ACTION",
    "GF_MAX_HOR_DIST",
    "GF_MAX_VER_DIST",
    "MIS_YAW_TMT",
    "NAV_DLL_ACT",
    "NAV_RCL_ACT",
    "RTL_LAND_DELAY",
    "RTL_RETURN_ALT",
    "TRIG_MODE",
)


@dataclass(frozen=True)
class Check:
    """One line of the checklist; ``remedy`` says how to change what is missing or off."""

    what: str
    found: str
    remedy: str = ""

    @property
    def fine(self) -> bool:
        """Whether nothing is missing or off."""
        return not self.remedy

    def __str__(self) -> str:
        mark, more = (" ok ", "") if self.fine else ("LOOK", f" -> {self.remedy}")
        return f"[{mark}] {self.what}: {self.found}{more}"


@dataclass(frozen=True)
class Reach:
    """How far from home, and how high above it, a flight may go, in m."""

    away_m: float
    highest_m: float
    """As far as that is known."""
    ceiling_m: float | None = None
    """The height that was given as the greatest one, above home."""
    geofence: Fence | None = None
    own: OwnFence | None = None
    """The vehicle's own fence; it is compared with the geofence."""


def ardupilot(values: Mapping[str, float], stations: frozenset[int], reach: Reach) -> Iterator[Check]:
    """ArduCopter's, from its parameters; ``stations`` are the ground stations that are heard."""
    yield _ground_station(values, stations)
    off = not values.get("FS_THR_ENABLE", 0.0)
    action = _action(values, "FS_THR_ENABLE", _REMOTE_ACTIONS)
    yield Check("lost remote control", action, "FS_THR_ENABLE 1" if off else "")
    yield _low_battery(values)
    yield _fence(values, reach)
    yield from _way_home(values)


def px4(values: Mapping[str, float], stations: frozenset[int], reach: Reach) -> Iterator[Check]:
    """PX4's, from its parameters; ``stations`` are the ground stations that are heard."""
    link = _action(values, "NAV_DLL_ACT", _LINK_ACTIONS)
    if values.get("NAV_DLL_ACT") not in _BRINGS_DOWN:
        yield Check("lost ground station", link, "NAV_DLL_ACT 2: in a pause nothing else brings it home")
    elif not stations:
        yield Check(
            "lost ground station",
            f"{link}, but none is heard",
            "connect one: without it, it does not arm, and this program is none",
        )
    else:
        goes_on = int(values.get("COM_DLL_EXCEPT", 0.0)) & _EXCEPT_MISSIONS
        yield Check("lost ground station", f"{link}, {'but continues' if goes_on else 'also on'} missions")
    off = values.get("NAV_RCL_ACT") not in _BRINGS_DOWN
    action = _action(values, "NAV_RCL_ACT", _LINK_ACTIONS)
    yield Check("lost remote control", action, "NAV_RCL_ACT 2" if off else "")
    off = not values.get("COM_LOW_BAT_ACT", 0.0)
    battery = _action(values, "COM_LOW_BAT_ACT", _LOW_BATTERY_ACTIONS)
    if "BAT_CRIT_THR" in values:
        battery += f" at {values['BAT_CRIT_THR']:.0%} (BAT_CRIT_THR)"
    yield Check("low battery", battery, "COM_LOW_BAT_ACT 3" if off else "")
    away_m, top_m = values.get("GF_MAX_HOR_DIST", 0.0), values.get("GF_MAX_VER_DIST", 0.0)
    polygon, polygon_wrong = _polygon(reach)
    found = _action(values, "GF_ACTION", _GEOFENCE_ACTIONS)
    found += f"; {away_m:.0f} m around home, up to {top_m:.0f} m (0: no limit){polygon}"
    wrong = []
    if values.get("GF_ACTION") not in _FENCE_BRINGS_DOWN or not (away_m or top_m or polygon):
        wrong += [f"GF_ACTION 3,{'' if polygon else ' GF_MAX_HOR_DIST,'} GF_MAX_VER_DIST"]
    else:
        wrong += [f"GF_MAX_HOR_DIST: {_goes(reach)}"] if 0.0 < away_m < reach.away_m else []
        wrong += _ceiling("GF_MAX_VER_DIST", top_m or math.inf, reach)
    yield Check("vehicle's fence", found, "; ".join([*wrong, *polygon_wrong]))
    yield _return_height(values.get("RTL_RETURN_ALT", math.nan), "RTL_RETURN_ALT")
    if values.get("RTL_LAND_DELAY", 0.0) < 0.0:
        yield Check("landing", "none: it stays above home (RTL_LAND_DELAY)", "RTL_LAND_DELAY 0")
    if values.get("MIS_YAW_TMT", 0.0) > 0.0:
        yield Check("turns", "it does not wait for its yaw (MIS_YAW_TMT)", "MIS_YAW_TMT -1")
    trigger = _action(values, "TRIG_MODE", _TRIGGERS)
    on_command = values.get("TRIG_MODE") in (1, 4)
    remedy = "TRIG_MODE 1, and TRIG_INTERFACE: the photographs of missions go through it"
    yield Check("camera trigger", trigger, "" if on_command else remedy)


def _ground_station(values: Mapping[str, float], stations: frozenset[int]) -> Check:
    what, action = "lost ground station", _action(values, "FS_GCS_ENABLE", _GCS_ACTIONS)
    name = "MAV_GCS_SYSID" if "MAV_GCS_SYSID" in values else "SYSID_MYGCS"
    lowest = values.get(name)
    if not values.get("FS_GCS_ENABLE", 0.0):
        return Check(what, action, "FS_GCS_ENABLE 1: in a pause nothing else brings it home")
    if lowest is None:
        return Check(what, f"{action}, of an unknown station ({name} is not told)", name)
    counted = range(round(lowest), round(max(lowest, values.get("MAV_GCS_SYSID_HI", 0.0))) + 1)
    systems = f"{counted[0]}" if len(counted) == 1 else f"{counted[0]} to {counted[-1]}"
    if SYSTEM in counted:
        found = f"{action}, but this program ({SYSTEM}) counts as a ground station ({name} {systems})"
        return Check(what, found, f"{name}: it hides that the ground station is lost")
    if not stations & set(counted):
        heard = ", ".join(map(str, sorted(stations))) or "none"
        found = f"{action}, but only of system {systems} ({name}), which is not heard (heard: {heard})"
        return Check(what, found, f"connect that ground station, or {name}: else it never acts")
    goes_on = int(values.get("FS_OPTIONS", 0.0)) & _CONTINUES_MISSION
    more = "but continues missions" if goes_on else "also on missions"
    return Check(what, f"{action}, {more} (FS_OPTIONS); of system {systems} ({name})")


def _low_battery(values: Mapping[str, float]) -> Check:
    low, critical = (
        _action(values, name, _BATTERY_ACTIONS) for name in ("BATT_FS_LOW_ACT", "BATT_FS_CRT_ACT")
    )
    limits = [
        f"{values[name]:g} {unit} ({name})"
        for name, unit in (("BATT_LOW_VOLT", "V"), ("BATT_LOW_MAH", "mAh"))
        if values.get(name, 0.0) > 0.0
    ]
    found = f"{low} at {' or '.join(limits) or 'no limit'}; critical: {critical}"
    if values.get("BATT_MONITOR") == 0.0:
        return Check("low battery", "off, the battery is not measured (BATT_MONITOR 0)", "BATT_MONITOR")
    if not values.get("BATT_FS_LOW_ACT", 0.0):
        return Check("low battery", found, "BATT_FS_LOW_ACT 2")
    return Check("low battery", found, "" if limits else "BATT_LOW_VOLT or BATT_LOW_MAH: else it never acts")


def _fence(values: Mapping[str, float], reach: Reach) -> Check:
    """ArduPilot's fence against where the flight may go."""
    kinds, (polygon, polygon_wrong) = int(values.get("FENCE_TYPE", 0.0)), _polygon(reach)
    radius_m, top_m = values.get("FENCE_RADIUS", math.inf), values.get("FENCE_ALT_MAX", math.inf)
    wrong = []
    on, arms = values.get("FENCE_ENABLE"), values.get("FENCE_AUTOENABLE", 0.0)
    if not on and arms != _ON_ARMING:
        found = "not told (FENCE_ENABLE)" if on is None else "off"
        found += f", also after the takeoff of a mission (FENCE_AUTOENABLE {arms:.0f})" if arms else ""
        wrong += [f"FENCE_ENABLE 1,{'' if polygon else ' FENCE_RADIUS,'} FENCE_ALT_MAX"]
    else:
        found = _action(values, "FENCE_ACTION", _FENCE_ACTIONS)
        found += "" if on else ", from arming on (FENCE_AUTOENABLE 3)"
        found += f"; {radius_m:.0f} m around home" if kinds & _CIRCLE else ""
        found += f", up to {top_m:.0f} m" if kinds & _CEILING else ""
        wrong += [f"FENCE_RADIUS: {_goes(reach)}"] if kinds & _CIRCLE and reach.away_m > radius_m else []
        if kinds & _CEILING:
            wrong += _ceiling("FENCE_ALT_MAX", top_m, reach)
        elif reach.ceiling_m is not None:
            wrong += [f"FENCE_TYPE {kinds | _CEILING}, FENCE_ALT_MAX: it has no ceiling"]
    if not values.get("FENCE_ACTION", 0.0):
        wrong += ["FENCE_ACTION 1"]
    if polygon and not kinds & _POLYGONS:
        wrong += [f"FENCE_TYPE {kinds | _POLYGONS}: its polygons do not act"]
    return Check("vehicle's fence", found + polygon, "; ".join([*wrong, *polygon_wrong]))


def _goes(reach: Reach) -> str:
    return f"the flight may go {reach.away_m:.0f} m from home"


def _ceiling(name: str, top_m: float, reach: Reach) -> list[str]:
    """What is wrong with the vehicle's own ceiling."""
    wanted_m = reach.ceiling_m
    if reach.highest_m > top_m:
        return [f"{name}: the flight may go up to {reach.highest_m:.0f} m"]
    if wanted_m is not None and top_m > wanted_m + _LOW_CEILING_M:
        return [f"{name}: its ceiling is far above the flight's {wanted_m:.0f} m (--highest)"]
    return []


def _polygon(reach: Reach) -> tuple[str, list[str]]:
    """How the geofence lies to the vehicle's own fence, and what is wrong with that."""
    geofence, own = reach.geofence, reach.own
    if geofence is None or own is None or own == OwnFence():
        return "", []
    if own.is_same(geofence):
        return "; its polygon is --geofence", []
    wrong = [f"its {own.others} other zones are not compared: look at them"] if own.others else []
    if not own.polygons:
        return "; no polygon to stay inside", wrong
    if own.contains(geofence):
        return "; --geofence is inside its polygon", wrong
    return "; --geofence is not inside its polygon", ["--upload-fence, or a smaller --geofence", *wrong]


def _way_home(values: Mapping[str, float]) -> Iterator[Check]:
    """ArduCopter's altitude of return, and whether it lands at home."""
    name, over = "RTL_ALT_M" if "RTL_ALT_M" in values else "RTL_ALT", "home"
    if values.get("RTL_ALT_TYPE", 0.0):
        over = "the ground (RTL_ALT_TYPE)"
    lower = ", lower near home (RTL_CONE_SLOPE)" if values.get("RTL_CONE_SLOPE", 0.0) else ""
    yield _return_height(
        values.get(name, math.nan) / (1.0 if name == "RTL_ALT_M" else 100.0), name, over, lower
    )
    for name, unit_m in (("RTL_ALT_FINAL_M", 1.0), ("RTL_ALT_FINAL", 0.01)):
        if (height_m := values.get(name, 0.0) * unit_m) > 0.0:
            yield Check("landing", f"none: it stays {height_m:g} m above home ({name})", f"{name} 0")


def _return_height(height_m: float, name: str, over: str = "home", lower: str = "") -> Check:
    if not height_m > 0.0:
        return Check("way home", "at the height where it is", f"{name}: it is to be above all obstacles")
    return Check(
        "way home", f"at {height_m:.0f} m above {over} or higher ({name}){lower}: above all obstacles?"
    )


def _action(values: Mapping[str, float], name: str, actions: Sequence[str]) -> str:
    value = values.get(name)
    if value is None:
        return f"not told ({name})"
    number = round(value)
    return f"{actions[number] if 0 <= number < len(actions) else 'unknown'} ({name} {number})"
