"""Whether a survey stays within the limits of a flight: the service checks missions only of views."""

from itertools import pairwise

from fvs_client.fly.errors import VehicleError
from fvs_client.fly.survey import Survey
from fvs_client.models.missions import MissionSettings
from fvs_schema.fence import Fence, Place

_HINT = "Give another survey (--survey, --survey-arc, --survey-start), or other limits."


def require_within_limits(survey: Survey, home: Place, mission: MissionSettings) -> None:
    """Raise ``VehicleError`` when a survey, or the way from home to it or back, leaves these limits."""
    reason = _reason(survey, home, mission)
    if reason is not None:
        raise VehicleError(f"The survey cannot be flown: {reason}.", hint=_HINT)


def _reason(survey: Survey, home: Place, mission: MissionSettings) -> str | None:
    height_m = survey.height_m
    highest_m, lowest_m = mission.get("highest_height_m"), mission.get("lowest_height_m")
    if highest_m is not None and height_m > highest_m:
        return f"it is {height_m:g} m above home, and the highest allowed is {highest_m:g} m"
    if lowest_m is not None and height_m < lowest_m:
        return f"it is {height_m:g} m above home, and the lowest allowed is {lowest_m:g} m"
    geofence = mission.get("geofence")
    if geofence is None:
        return None
    try:
        fence = Fence.parse(geofence)
    except ValueError as error:
        return f"the geofence cannot be read: {error}"
    if not fence.has(home):
        return "home is outside of the geofence"
    places = survey.places
    for number, place in enumerate(places, start=1):
        if not fence.has(place):
            return f"photograph {number} of {len(places)} is outside of the geofence"
    names = ["home", *(f"photograph {number}" for number in range(1, len(places) + 1)), "home"]
    for (start, end), (before, after) in zip(pairwise([home, *places, home]), pairwise(names), strict=True):
        if fence.crosses(start, end):
            return f"the way from {before} to {after} leaves the geofence"
    return None
