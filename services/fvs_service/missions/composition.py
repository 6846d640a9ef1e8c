"""Views made into a mission: checked, in order, with the ways between them."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from fvs_schema.error_codes import FieldError
from fvs_schema.missions import Finish, MissionOptions
from fvs_schema.scenes import AltitudeDatum
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.altitudes import Altitudes
from fvs_service.missions.flight import Home, Mission, Waypoint
from fvs_service.missions.objections import Objections

_SAME_M = 0.5
"""Shorter vertical ways are ignored."""
_CLEAR_OF_GROUND_M = 2.0
"""Minimum height of a takeoff."""
MOST_NAMED = 16
"""Maximum number of views whose reasons an error or answer gives."""


@dataclass(frozen=True)
class Leg:
    """A view, and where to pass on the way to it; altitudes are the scene's."""

    view: Waypoint
    via: tuple[Waypoint, ...] = ()


@dataclass(frozen=True)
class Violation:
    """Why a view cannot be flown."""

    view: str
    reason: str


class Composer:
    """Makes missions with the same options; ``altitudes`` and ``ground_m`` as in ``Objections``."""

    def __init__(self, options: MissionOptions, altitudes: Altitudes, ground_m: float | None) -> None:
        self._options, self._altitudes = options, altitudes
        self._objections = Objections(options, altitudes, ground_m)

    def mission(
        self, name: str, legs: Sequence[Leg], via_home: Sequence[Waypoint], datum: AltitudeDatum
    ) -> tuple[Mission, tuple[Violation, ...]]:
        """The mission through ``legs``, and what was left out of it.

        Raises ``InvalidRequestError`` for views that cannot be flown, unless they are to be left out.
        """
        flown, via_home, violations = self._flyable(legs, via_home)
        if violations and not (flown and self._options.leave_out):
            raise _refusal(violations, leave_out=self._options.leave_out)
        offset_m = self._altitudes.offset(datum)
        assert offset_m is not None, "the datum was chosen among those that are known"
        waypoints = tuple(self._waypoints(flown, via_home))
        home, climb_m = self._home(), None
        if home is not None and self._options.takeoff:
            climb_m = self._climb(waypoints) + offset_m
        moved = tuple(replace(point, altitude_m=point.altitude_m + offset_m) for point in waypoints)
        return Mission(name, datum, moved, home, climb_m, self._options), violations

    def _flyable(
        self, legs: Sequence[Leg], via_home: Sequence[Waypoint]
    ) -> tuple[list[Leg], Sequence[Waypoint], tuple[Violation, ...]]:
        """The legs that can be flown one after the other, the way home, and why other views cannot be flown.

        Positions to pass belong to the way between two views, and go with the one that is left out.
        """
        flown: list[Leg] = []
        violations: list[Violation] = []
        leave_out, reason, follows = self._options.leave_out, None, True
        for leg in legs:
            before = flown[-1].view.place if flown else self._options.home
            via = leg.via if follows else ()
            reason = self._objections.to_view(leg.view) or self._objections.to_way(before, via, leg.view)
            if reason is not None:
                violations.append(Violation(str(leg.view.name), reason))
            follows = reason is None or not leave_out
            if follows:
                flown.append(Leg(leg.view, via))
        way_home = via_home if follows else ()
        while flown and (leave_out or reason is None):
            reason = self._objections.to_way_home(flown[-1].view, way_home)
            if reason is None:
                break
            violations.append(Violation(str(flown[-1].view.name), reason))
            if leave_out:
                flown.pop()
                way_home = ()
        return flown, way_home, tuple(violations)

    def _waypoints(self, legs: Sequence[Leg], via_home: Sequence[Waypoint]) -> Iterator[Waypoint]:
        """The views, and between them what is passed."""
        before: Waypoint | None = None
        for leg in legs:
            view = leg.view
            if leg.via:
                yield from leg.via
            elif (transit_m := self._transit(*(point for point in (before, view) if point))) is not None:
                if before is not None and transit_m - before.altitude_m > _SAME_M:
                    yield replace(before, name=None, altitude_m=transit_m)
                if transit_m - view.altitude_m > _SAME_M:
                    yield replace(view, name=None, altitude_m=transit_m)
            yield view
            before = view
        if self._options.finish is Finish.RETURN and before is not None:
            transit_m = self._transit(before)
            if via_home:
                yield from via_home
            elif transit_m is not None and transit_m - before.altitude_m > _SAME_M:
                yield replace(before, name=None, altitude_m=transit_m)

    def _transit(self, *ends: Waypoint) -> float | None:
        """The altitude of a way between ``ends``; None if it is straight."""
        transit_m, home_m = self._options.transit_height_m, self._altitudes.home_m
        if transit_m is None or home_m is None:
            return None
        return max(home_m + transit_m, *(end.altitude_m for end in ends))

    def _climb(self, waypoints: Sequence[Waypoint]) -> float:
        """The altitude to take off to."""
        home_m = self._altitudes.home_m
        first_m = waypoints[0].altitude_m
        return first_m if home_m is None else max(first_m, home_m + _CLEAR_OF_GROUND_M)

    def _home(self) -> Home | None:
        place, home_m = self._options.home, self._altitudes.home_m
        if place is None:
            return None
        above_sea_m = self._altitudes.offset(AltitudeDatum.SEA_LEVEL)
        if home_m is None or above_sea_m is None:
            return Home(*place, sea_level_m=None)
        return Home(*place, sea_level_m=home_m + above_sea_m)


def _refusal(violations: Sequence[Violation], *, leave_out: bool) -> InvalidRequestError:
    """The error that names the views which cannot be flown; with ``leave_out`` no other view is left."""
    first, count = violations[0], len(violations)
    if count == 1:
        message = f"The view {first.view} cannot be flown: {first.reason}."
    else:
        message = f"{count} views cannot be flown. The first is {first.view}: {first.reason}."
    hint = "Change the options, choose other candidates, or leave these views out with leave_out=true."
    if leave_out:
        message = f"No view is left. {message}"
        hint = "Change the options, or choose other candidates."
    return InvalidRequestError(
        message,
        hint=hint,
        errors=[FieldError(violation.view, violation.reason) for violation in violations[:MOST_NAMED]],
    )
