"""Why a view, or the way to it, cannot be flown."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

from fvs_schema.error_codes import FieldError
from fvs_schema.fence import Place
from fvs_schema.missions import Finish, MissionOptions
from fvs_service.errors import InvalidRequestError
from fvs_service.missions import gimbal
from fvs_service.missions.altitudes import Altitudes
from fvs_service.missions.flight import Waypoint
from fvs_service.missions.ground import Ground, described
from fvs_service.missions.times import length_m

_ROUNDING_DEG = 1e-6
_ROUNDING_M = 1e-3
_FARTHEST_M = 20_000.0
"""No multirotor flies farther from home and back on a battery."""


class Objections:
    """Objections of a mission's options to views and ways; None is no objection.

    ``altitudes`` are the scene's. ``ground`` is what heights are measured from; without it that is home, or,
    where home's altitude is not known, a floor at the altitude ``ground``: that of the model's lowest point.
    Raises ``InvalidRequestError`` for options that need home's altitude without it, and for a home outside of
    the geofence.
    """

    def __init__(self, options: MissionOptions, altitudes: Altitudes, ground: Ground | float | None) -> None:
        self._options, self._altitudes, self._ground = options, altitudes, ground
        self._fence = options.fence
        if altitudes.home_m is None:
            for name in ("transit_height_m", "lowest_height_m", "highest_height_m", "battery_s"):
                if getattr(options, name) is not None:
                    raise InvalidRequestError(
                        f"{name} is measured from home, whose altitude is not known.",
                        hint="Give home_altitude_m, above the datum of the scene's altitudes.",
                        errors=[FieldError(name, "home_altitude_m is missing")],
                    )
        if self._fence is not None and options.home is not None and not self._fence.has(options.home):
            raise InvalidRequestError(
                "Home is outside of the geofence.",
                hint="Give another home, or another geofence.",
                errors=[FieldError("geofence", "home is outside")],
            )

    def to_view(self, view: Waypoint) -> str | None:
        """Why a view cannot be photographed, whatever the way to it."""
        if self._options.home is not None:
            latitude_deg, longitude_deg = self._options.home
            away_m = length_m([view, replace(view, latitude_deg=latitude_deg, longitude_deg=longitude_deg)])
            if away_m > _FARTHEST_M:
                return f"it is {away_m / 1000:.0f} km from home; {_FARTHEST_M / 1000:g} km are the most"
        low_deg, high_deg = self._options.gimbal_lowest_deg, self._options.gimbal_highest_deg
        if not low_deg - _ROUNDING_DEG <= view.pitch_deg <= high_deg + _ROUNDING_DEG:
            return (
                f"it needs a gimbal pitch of {view.pitch_deg:.1f}°; {low_deg:g}° to {high_deg:g}° are allowed"
            )
        if self._options.format.of_gimbals and (reason := gimbal.objection(view)) is not None:
            return reason
        reason = self._to_height("it is", view)
        if reason is None and self._fence is not None and not self._fence.has(view.place):
            return "it is outside of the geofence"
        return reason

    def to_way(self, before: Place | None, via: Sequence[Waypoint], view: Waypoint) -> str | None:
        """Why the way to a view cannot be flown, from ``before`` if that is known."""
        start = [] if before is None else [before]
        if self._leaves([*start, *(point.place for point in via), view.place]):
            return "the way to it leaves the geofence"
        for point in via:
            if (reason := self._to_height("the way to it is", point)) is not None:
                return reason
        transit_m, highest_m = self._options.transit_height_m, self._options.highest_height_m
        if isinstance(self._ground, Ground):  # ``over_ground`` sees what is flown
            return None
        if highest_m is not None and transit_m is not None and transit_m > highest_m:
            return f"the transit to it is {transit_m:g} m above home; the highest allowed is {highest_m:g} m"
        return None

    def to_way_home(self, view: Waypoint, via: Sequence[Waypoint]) -> str | None:
        """Why the way home from a view cannot be flown."""
        if self._options.finish is not Finish.RETURN:
            return None
        home = [] if self._options.home is None else [self._options.home]
        if self._leaves([view.place, *(point.place for point in via), *home]):
            return "the way home from it leaves the geofence"
        for point in via:
            if (reason := self._to_height("the way home from it is", point)) is not None:
                return reason
        return None

    def over_ground(self, what: str, way: Sequence[Waypoint]) -> str | None:
        """Why ``what``, which is flown straight from waypoint to waypoint, is too near to the terrain."""
        if not isinstance(self._ground, Ground):
            return None
        known = []
        for height_m, place in self._ground.heights_over(way):
            if height_m is None:
                return f"{what} leads over {described(place)}, where the terrain has no height"
            known.append((height_m, place))
        for height_m, place in (min(known), max(known)) if known else ():
            if (reason := self._to_terrain(f"{what} is, over {described(place)},", height_m)) is not None:
                return reason
        return None

    def _to_height(self, what: str, point: Waypoint) -> str | None:
        """Why ``what`` is at a wrong altitude."""
        if isinstance(self._ground, Ground):
            ground_m = self._ground.altitude_m(point.place)
            if ground_m is None:
                return f"{what} at {described(point.place)}, where the terrain has no height"
            return self._to_terrain(what, point.altitude_m - ground_m)
        height_m = self._altitudes.height(point.altitude_m)
        if height_m is None:
            if self._ground is None or point.altitude_m >= self._ground:
                return None
            below_m = self._ground - point.altitude_m
            return f"{what} under ground: {below_m:.1f} m below the lowest point of the model"
        lowest_m, highest_m = self._options.lowest_height_m or 0.0, self._options.highest_height_m
        if height_m < min(lowest_m, 0.0):
            return f"{what} {-height_m:.1f} m below home; the lowest allowed is {lowest_m:g} m"
        if height_m < lowest_m:
            return f"{what} {height_m:.1f} m above home; the lowest allowed is {lowest_m:g} m"
        if highest_m is not None and height_m > highest_m:
            return f"{what} {height_m:.1f} m above home; the highest allowed is {highest_m:g} m"
        return None

    def _to_terrain(self, what: str, height_m: float) -> str | None:
        """Why ``what`` is at a wrong height above the terrain."""
        lowest_m, highest_m = self._options.lowest_height_m or 0.0, self._options.highest_height_m
        if height_m < min(lowest_m, 0.0) - _ROUNDING_M:
            return f"{what} under ground: {-height_m:.1f} m below the terrain"
        if height_m < lowest_m - _ROUNDING_M:
            return f"{what} {height_m:.1f} m above the ground; the lowest allowed is {lowest_m:g} m"
        if highest_m is not None and height_m > highest_m + _ROUNDING_M:
            return f"{what} {height_m:.1f} m above the ground; the highest allowed is {highest_m:g} m"
        return None

    def _leaves(self, places: Sequence[Place]) -> bool:
        fence = self._fence
        if fence is None:
            return False
        inside = all(map(fence.has, places))
        return not inside or any(fence.crosses(start, end) for start, end in pairwise(places))
