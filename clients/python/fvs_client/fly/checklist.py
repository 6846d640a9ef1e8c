"""The checklist before takeoff: what the vehicle says of itself, and how to change what is off."""

import math
from collections.abc import Iterator, Mapping
from itertools import pairwise

from fvs_client.fly import failsafes
from fvs_client.fly.connection import Equipment
from fvs_client.fly.failsafes import Check, Reach
from fvs_client.fly.places import apart_m
from fvs_client.fly.settings import FlightSettings
from fvs_client.fly.vehicle import Vehicle
from fvs_schema.fence import Fence, Place
from fvs_schema.missions import Autopilot

__all__ = ["Check", "checklist"]

_STRONG_M_S = 10.0
"""A strong breeze, which small drones are not made for."""
_HIGH_M = 120.0
"""The height of missions without a limit."""
_ALL_CHECKS = 1
"""Bit of ``ARMING_CHECK``."""
_PHOTOGRAPH_S = 8.0
"""Time that the vehicle holds still at a photograph of a survey."""


def checklist(vehicle: Vehicle, settings: FlightSettings, equipment: Equipment, camera: Check) -> list[Check]:
    """What a pilot checks before takeoff, in the order of a briefing; takes some seconds.

    Raises ``NoAnswerError`` for a vehicle that is silent.
    """
    ardupilot = vehicle.dialect.autopilot is Autopilot.ARDUPILOT
    values = vehicle.parameters(failsafes.ARDUPILOT if ardupilot else failsafes.PX4)
    own = failsafes.ardupilot if ardupilot else failsafes.px4
    reach = _reach(vehicle, settings)
    return [
        *_vehicle(vehicle, values, ardupilot=ardupilot),
        *own(values, vehicle.stations, reach),
        *_flight(vehicle, settings, reach),
        camera,
        _gimbal(equipment),
    ]


def _vehicle(vehicle: Vehicle, values: Mapping[str, float], *, ardupilot: bool) -> Iterator[Check]:
    state = vehicle.state
    firmware = "ArduCopter" if ardupilot else "PX4"
    yield Check("autopilot", f"{firmware} {vehicle.version() or 'of unknown version'}, in {state.mode_name}")
    yield _arming(vehicle, values)
    home = vehicle.home
    yield Check(
        "home",
        f"{home.latitude_deg:.6f}, {home.longitude_deg:.6f}, {home.altitude_m:.1f} m above sea level; "
        f"GPS fix {state.fix} with {state.satellites} satellites",
    )
    wind_m_s = vehicle.wind_m_s
    if not wind_m_s:  # ArduCopter sends 0 where it has no estimate
        yield Check("wind", "not estimated: look yourself")
    else:
        remedy = f"wait: more than {_STRONG_M_S:.0f} m/s" if wind_m_s > _STRONG_M_S else ""
        yield Check("wind", f"{wind_m_s:.1f} m/s as the autopilot estimates it", remedy)


def _arming(vehicle: Vehicle, values: Mapping[str, float]) -> Check:
    if vehicle.state.armed:
        return Check("arming", "armed already", "somebody else has armed it: is --take-over meant?")
    objections = vehicle.arming_objections()
    if objections:
        return Check("arming", "; ".join(objections), "mend it: the vehicle will not arm")
    checks = int(values.get("ARMING_CHECK", _ALL_CHECKS))
    if not checks & _ALL_CHECKS:
        some = "some of its checks" if checks else "its checks"
        return Check("arming", f"disarmed; {some} are off", "ARMING_CHECK 1")
    if values.get("ARMING_SKIPCHK", 0.0) != 0.0:
        return Check("arming", "disarmed; some of its checks are off", "ARMING_SKIPCHK 0")
    return Check("arming", "disarmed, nothing prevents it")


def _flight(vehicle: Vehicle, settings: FlightSettings, reach: Reach) -> Iterator[Check]:
    battery = vehicle.state.battery
    if battery is not None:
        low = battery <= settings.reserve
        found = f"{battery:.0%}; it returns at {settings.reserve:.0%}"
        yield Check("battery", found, "a full battery, or a lower --reserve" if low else "")
    yield Check("distance", _distance(vehicle, settings, reach))
    mission = settings.mission
    lowest = mission.get("lowest_height_m")
    over = "the ground" if settings.terrain is not None else "home"
    band = f"{'no lowest' if lowest is None else f'{lowest:g} m'} to "
    yield Check("heights", f"{band}{mission.get('highest_height_m', _HIGH_M):g} m above {over}")
    yield _geofence(vehicle, settings)
    stations = ", ".join(map(str, sorted(vehicle.stations)))
    yield Check("who else commands", f"ground stations {stations}" if stations else "nobody is heard")


def _distance(vehicle: Vehicle, settings: FlightSettings, reach: Reach) -> str:
    """How far the flight is, as far as that is known before it."""
    speed_m_s, survey, home = settings.mission.get("speed_m_s", 5.0), settings.survey, vehicle.home.place
    found = ""
    if survey is not None:
        way_m = sum(apart_m(*both) for both in pairwise([home, *survey.places, home])) + 2.0 * survey.height_m
        takes_min = (way_m / speed_m_s + survey.count * _PHOTOGRAPH_S) / 60.0
        found = f"the survey and back {way_m:.0f} m, {takes_min:.0f} min or more; "
    if reach.away_m:
        away_s = math.hypot(reach.away_m, reach.highest_m) / speed_m_s
        return f"{found}{reach.away_m:.0f} m from home at most, {away_s:.0f} s at {speed_m_s:g} m/s"
    return found + "how far from home depends on the views"


def _geofence(vehicle: Vehicle, settings: FlightSettings) -> Check:
    text = settings.mission.get("geofence")
    if text is None:
        return Check("geofence", "none", "--geofence")
    fence = Fence.parse(text)
    inside = fence.has(vehicle.home.place)
    found = f"{len(fence.corners)} corners, home is {'inside' if inside else 'outside'}"
    return Check("geofence", found, "" if inside else "--geofence: the way home leaves it")


def _gimbal(equipment: Equipment) -> Check:
    gimbal = equipment.gimbal_deg
    pitch = "none reports itself" if gimbal is None else f"pitch {gimbal[0]:.0f}° to {gimbal[1]:.0f}°"
    return Check("gimbal", pitch, "" if gimbal else "MNT1_TYPE, or a gimbal manager")


def _reach(vehicle: Vehicle, settings: FlightSettings) -> Reach:
    """How far the flight may go, as far as that is known before it."""
    home, mission, survey = vehicle.home.place, settings.mission, settings.survey
    places: list[Place] = [] if survey is None else list(survey.places)
    geofence = own = None
    if "geofence" in mission:
        geofence, own = Fence.parse(mission["geofence"]), vehicle.fence()
        places += geofence.corners
    away_m = max((apart_m(home, place) for place in places), default=0.0)
    ceiling_m = mission.get("highest_height_m")
    if settings.terrain is not None:  # heights are above the ground
        return Reach(away_m, 0.0, None, geofence, own)
    highest_m = ceiling_m if ceiling_m is not None else 0.0 if survey is None else survey.height_m
    return Reach(away_m, highest_m, ceiling_m, geofence, own)
