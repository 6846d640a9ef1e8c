"""Views made into a mission: checked, in order, with the ways between them."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from math import inf

from fvs_schema.error_codes import FieldError
from fvs_schema.fence import Place
from fvs_schema.missions import Finish, MissionOptions
from fvs_schema.scenes import AltitudeDatum
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.altitudes import Altitudes
from fvs_service.missions.flight import Home, Mission, Waypoint
from fvs_service.missions.ground import Ground
from fvs_service.missions.objections import Objections
from fvs_service.missions.parts import fewest_parts
from fvs_service.missions.times import LANDING_S, at_view_s, flying_s, length_m

_SAME_M = 0.6
"""Shorter vertical ways are ignored: Litchi flies none."""
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
    """Makes missions with the same options; ``altitudes`` and ``ground`` as in ``Objections``.

    ``follows``: between waypoints the vehicle keeps the height above the ground, as it gets from one to the
    next.
    """

    def __init__(
        self,
        options: MissionOptions,
        altitudes: Altitudes,
        ground: Ground | float | None,
        *,
        follows: bool = False,
    ) -> None:
        self._options, self._altitudes = options, altitudes
        self._terrain = ground if isinstance(ground, Ground) else None
        self._follows = follows
        self._objections = Objections(options, altitudes, ground)

    def missions(
        self, name: str, legs: Sequence[Leg], via_home: Sequence[Waypoint], datum: AltitudeDatum
    ) -> tuple[tuple[Mission, ...], tuple[Violation, ...]]:
        """The mission through ``legs``, cut to a battery if that is asked for, and what was left out of it.

        Raises ``InvalidRequestError`` for views that cannot be flown, unless they are to be left out.
        """
        beyond: Mapping[str, str] = {}
        parts: Sequence[range] = ()
        while not parts:
            flown, way_home, violations = self._flyable(legs, via_home, beyond)
            if violations and not (flown and self._options.leave_out):
                raise _refusal(violations, leave_out=self._options.leave_out)
            parts, farther = self._cut(flown, way_home)
            beyond = {**beyond, **farther}
        missions = []
        for number, part in enumerate(parts, start=1):
            of_part = [self._leg(flown, index, part.start) for index in part]
            numbered = name if self._options.battery_s is None else f"{name}-{number}-of-{len(parts)}"
            home_via = way_home if part.stop == len(flown) else ()
            missions.append(self._mission(numbered, of_part, home_via, datum))
        return tuple(missions), violations

    def _mission(
        self, name: str, legs: Sequence[Leg], via_home: Sequence[Waypoint], datum: AltitudeDatum
    ) -> Mission:
        offset_m = self._altitudes.offset(datum)
        assert offset_m is not None, "the datum was chosen among those that are known"
        waypoints = tuple(self._waypoints(legs, via_home))
        home, climb_m = self._home(), None
        if home is not None and self._options.takeoff:
            climb_m = self._climb(waypoints[0]) + offset_m

        def moved(points: Sequence[Waypoint]) -> tuple[Waypoint, ...]:
            return tuple(
                replace(
                    point,
                    altitude_m=point.altitude_m + offset_m,
                    above_ground_m=self._above_ground(point),
                )
                for point in points
            )

        way = [*self._way_from_home(legs[0])[:-1], *self._between(legs)]
        way += self._way_to_home(legs[-1].view, via_home)[1:]
        return Mission(
            *(name, datum, moved(waypoints), home, climb_m, self._options, moved(way)),
            length_m=length_m(way),
            duration_s=self._flying_s(way) + len(legs) * self._at_view_s + self._landing_s,
        )

    def _cut(
        self, legs: Sequence[Leg], via_home: Sequence[Waypoint]
    ) -> tuple[tuple[range, ...], Mapping[str, str]]:
        """The parts that a battery lasts for; without any, why which views cannot be flown alone.

        If each view can be flown alone, there are parts.
        """
        battery_s, reserve = self._options.battery_s, self._options.battery_reserve
        if battery_s is None:
            return (range(len(legs)),), {}
        longest_s = (1.0 - reserve) * battery_s
        away_s, between_s, back_s, reasons = [], [0.0], [], {}
        for before, leg in pairwise(legs):
            way = [before.view, *self._passed(before.view, leg), leg.view]
            between_s.append(self._flying_s(way) + self._at_view_s)
        for index, leg in enumerate(legs):
            first, home_via = self._leg(legs, index, index), via_home if leg is legs[-1] else ()
            no_way, no_way_home = self._to_way(None, first), self._to_way_home(leg.view, home_via)
            away_s.append(inf if no_way else self._flying_s(self._way_from_home(first)) + self._at_view_s)
            back_s.append(
                inf
                if no_way_home
                else self._flying_s(self._way_to_home(leg.view, home_via)) + self._landing_s
            )
            alone_s = away_s[-1] + back_s[-1]
            too_far = (
                f"to it alone and back it takes {alone_s:.0f} s; a battery of {battery_s:g} s "
                f"flies {longest_s:.0f} s and keeps a reserve of {reserve:.0%}"
            )
            if reason := no_way or no_way_home or (too_far if alone_s > longest_s else None):
                reasons[str(leg.view.name)] = reason
        parts = fewest_parts(away_s, between_s, back_s, longest_s)
        return ((), reasons) if parts is None else (parts, {})

    @property
    def _at_view_s(self) -> float:
        return at_view_s(self._options.hold_s)

    @property
    def _landing_s(self) -> float:
        returns = self._options.finish is Finish.RETURN and self._options.home is not None
        return LANDING_S if returns else 0.0

    def _flying_s(self, way: Sequence[Waypoint]) -> float:
        return flying_s(way, self._options.speed_m_s)

    @staticmethod
    def _leg(legs: Sequence[Leg], index: int, first: int) -> Leg:
        """A leg of a part that begins with the leg ``first``.

        To that the way is from home, and positions to pass belong to the way from the view before.
        """
        return replace(legs[index], via=()) if index == first > 0 else legs[index]

    def _way_from_home(self, leg: Leg) -> Sequence[Waypoint]:
        """What is flown to the first view, from the takeoff if home is known."""
        way = [*self._passed(None, leg), leg.view]
        if self._options.home is None:
            return way
        above = self._above_home(self._options.home, way[0], self._climb(way[0]))
        return [*self._at_home(above), above, *way] if self._options.takeoff else [above, *way]

    def _way_to_home(self, view: Waypoint, via_home: Sequence[Waypoint]) -> Sequence[Waypoint]:
        """What is flown from the last view to the landing: home at the altitude of the last waypoint."""
        way = [view, *self._passed_home(view, via_home)]
        if self._options.home is None or self._options.finish is not Finish.RETURN:
            return way
        above = self._above_home(self._options.home, way[-1], way[-1].altitude_m)
        return [*way, above, *self._at_home(above)]

    @staticmethod
    def _above_home(home: Place, point: Waypoint, altitude_m: float) -> Waypoint:
        return replace(point, name=None, latitude_deg=home[0], longitude_deg=home[1], altitude_m=altitude_m)

    def _at_home(self, above: Waypoint) -> Sequence[Waypoint]:
        """Home on the ground, if its altitude is known."""
        home_m = self._altitudes.home_m
        return () if home_m is None else (replace(above, altitude_m=home_m),)

    def _flyable(
        self, legs: Sequence[Leg], via_home: Sequence[Waypoint], beyond: Mapping[str, str]
    ) -> tuple[list[Leg], Sequence[Waypoint], tuple[Violation, ...]]:
        """The legs that can be flown one after the other, the way home, and why other views cannot be flown.

        ``beyond``: views that no battery reaches, and why. Positions to pass belong to the way between two
        views, and go with the one that is left out.
        """
        flown: list[Leg] = []
        violations: list[Violation] = []
        leave_out, reason, follows = self._options.leave_out, None, True
        for leg in legs:
            before = flown[-1].view if flown else None
            via = leg.via if follows else ()
            reason = (
                self._objections.to_view(leg.view)
                or self._to_way(before, Leg(leg.view, via))
                or beyond.get(str(leg.view.name))
            )
            if reason is not None:
                violations.append(Violation(str(leg.view.name), reason))
            follows = reason is None or not leave_out
            if follows:
                flown.append(Leg(leg.view, via))
        way_home = via_home if follows else ()
        while flown and (leave_out or reason is None):
            reason = self._to_way_home(flown[-1].view, way_home)
            if reason is None:
                break
            violations.append(Violation(str(flown[-1].view.name), reason))
            if leave_out:
                flown.pop()
                way_home = ()
        return flown, way_home, tuple(violations)

    def _to_way(self, before: Waypoint | None, leg: Leg) -> str | None:
        start = before.place if before else self._options.home
        reason = self._objections.to_way(start, leg.via, leg.view)
        if reason is not None or self._follows:
            return reason
        passed = [*self._passed(before, leg), leg.view]
        if before is None and self._options.home is not None and self._options.takeoff:
            before = self._above_home(self._options.home, passed[0], self._climb(passed[0]))
        return self._objections.over_ground("the way to it", [before, *passed] if before else passed)

    def _to_way_home(self, view: Waypoint, via_home: Sequence[Waypoint]) -> str | None:
        """Why the way home cannot be flown; at which altitude the vehicle returns from its end is its own."""
        reason = self._objections.to_way_home(view, via_home)
        if reason is not None or self._follows:
            return reason
        way = [view, *self._passed_home(view, via_home)]
        return self._objections.over_ground("the way home from it", way)

    def _waypoints(self, legs: Sequence[Leg], via_home: Sequence[Waypoint]) -> Iterator[Waypoint]:
        """The views, and what is passed on the way to each, and home."""
        yield from self._passed(None, legs[0])
        yield from self._between(legs)
        yield from self._passed_home(legs[-1].view, via_home)

    def _between(self, legs: Sequence[Leg]) -> Iterator[Waypoint]:
        """From the first view to the last one."""
        yield legs[0].view
        for before, leg in pairwise(legs):
            yield from self._passed(before.view, leg)
            yield leg.view

    def _passed(self, before: Waypoint | None, leg: Leg) -> Sequence[Waypoint]:
        """What is passed between the view ``before`` and that of the leg."""
        view = leg.view
        if leg.via:
            return leg.via
        start = before.place if before else self._options.home
        transit_m = self._transit([start, view.place] if start else [view.place])
        if transit_m is None:
            return ()
        ends = [before, view] if before else [view]
        transit_m = max(transit_m, *(end.altitude_m for end in ends))
        return [
            replace(end, name=None, altitude_m=transit_m)
            for end in ends
            if transit_m - end.altitude_m > _SAME_M
        ]

    def _passed_home(self, last: Waypoint, via_home: Sequence[Waypoint]) -> Sequence[Waypoint]:
        """What is passed after the last view."""
        if self._options.finish is not Finish.RETURN or via_home:
            return via_home if self._options.finish is Finish.RETURN else ()
        home = self._options.home
        transit_m = self._transit([last.place, home] if home else [last.place])
        if transit_m is None or transit_m - last.altitude_m <= _SAME_M:
            return ()
        return [replace(last, name=None, altitude_m=transit_m)]

    def _transit(self, places: Sequence[Place]) -> float | None:
        """The altitude of a transit over ``places``; None if ways are straight."""
        transit_m, from_m = self._options.transit_height_m, self._altitudes.home_m
        if self._terrain is not None:
            from_m = self._terrain.highest_m(places)
        return None if transit_m is None or from_m is None else from_m + transit_m

    def _climb(self, first: Waypoint) -> float:
        """The altitude to take off to, on the way to the ``first`` waypoint."""
        home_m = self._altitudes.home_m
        if home_m is None:
            return first.altitude_m
        lowest_m = 0.0 if self._terrain is None else self._options.lowest_height_m or 0.0
        return max(first.altitude_m, home_m + max(_CLEAR_OF_GROUND_M, lowest_m))

    def _above_ground(self, point: Waypoint) -> float | None:
        ground_m = None if self._terrain is None else self._terrain.altitude_m(point.place)
        return None if ground_m is None else point.altitude_m - ground_m

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
