"""Whether a survey stays within the limits of a flight: the service checks missions only of views."""

from itertools import pairwise

from fvs_client.fly.errors import VehicleError
from fvs_client.fly.ground import Ground, described
from fvs_client.fly.survey import Survey
from fvs_client.models.missions import MissionSettings
from fvs_schema.fence import Fence, Place

_ROUNDING_M = 1e-3
_HINT = "Give another survey (--survey, --survey-arc, --survey-start), or other limits."


def require_within_limits(
    survey: Survey, home: Place, mission: MissionSettings, ground: Ground | None = None
) -> None:
    """Raise ``VehicleError`` when a survey, or the way from home to it or back, leaves these limits.

    Over a ``ground`` the limits are heights above it. The altitude of the return is the autopilot's.
    """
    reason = _at_height(survey, mission, ground) or _in_fence(survey, home, mission)
    if reason is None and ground is not None:
        reason = _over_ground(survey, home, mission, ground)
    if reason is not None:
        raise VehicleError(f"The survey cannot be flown: {reason}.", hint=_HINT)


def _at_height(survey: Survey, mission: MissionSettings, ground: Ground | None) -> str | None:
    height_m, above = survey.height_m, "home" if ground is None else "the ground"
    highest_m, lowest_m = mission.get("highest_height_m"), mission.get("lowest_height_m")
    if highest_m is not None and height_m > highest_m:
        return f"it is {height_m:g} m above {above}, and the highest allowed is {highest_m:g} m"
    if lowest_m is not None and height_m < lowest_m:
        return f"it is {height_m:g} m above {above}, and the lowest allowed is {lowest_m:g} m"
    return None


def _in_fence(survey: Survey, home: Place, mission: MissionSettings) -> str | None:
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
    for (start, end), names in zip(pairwise([home, *places, home]), _ways(survey), strict=True):
        if fence.crosses(start, end):
            return f"the way {names} leaves the geofence"
    return None


def _over_ground(survey: Survey, home: Place, mission: MissionSettings, ground: Ground) -> str | None:
    lowest_m = max(mission.get("lowest_height_m", 0.0), 0.0)
    heights = [survey.climb_m(ground), *survey.heights_m(ground)]
    ways = zip(pairwise([home, *survey.places]), pairwise(heights), _ways(survey), strict=False)
    for (start, end), heights_m, names in ways:
        height_m, place = min(ground.over(start, end, heights_m))
        if height_m < lowest_m - _ROUNDING_M:
            where = f"the way {names} is {abs(height_m):.1f} m"
            side = "above" if height_m >= 0.0 else "below"
            return (
                f"{where} {side} the ground at {described(place)}, and the lowest allowed is {lowest_m:g} m"
            )
    return None


def _ways(survey: Survey) -> list[str]:
    names = ["home", *(f"photograph {number}" for number in range(1, survey.count + 1)), "home"]
    return [f"from {before} to {after}" for before, after in pairwise(names)]
