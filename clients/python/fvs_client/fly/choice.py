"""Chooses where a vehicle flies next: the first of a ranking, or several views of a plan."""

import math
from collections import Counter
from collections.abc import Iterator, Sequence
from functools import partial
from itertools import zip_longest

from fvs_client import (
    AltitudeDatum,
    Candidate,
    ConflictError,
    InvalidRequestError,
    Plan,
    Ranking,
    Scene,
    Tour,
    VehiclePose,
    VisitState,
)
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.ground import Ground, described
from fvs_client.fly.items import Command, Frame, holding, read_waypoints
from fvs_client.fly.leg import Leg
from fvs_client.fly.log import FlightLog
from fvs_client.fly.places import apart_m
from fvs_client.fly.settings import EndedError, Ending, FlightSettings
from fvs_client.fly.vehicle import Vehicle
from fvs_client.fly.watch import Watch
from fvs_client.height_model import places_of
from fvs_client.models.missions import MissionFile, MissionSettings
from fvs_schema.candidates import AroundCurrent, CandidateStatus
from fvs_schema.fence import Fence
from fvs_schema.missions import MissionFormat
from fvs_schema.scenes import Origin
from fvs_schema.terrain import Terrain

_TAKEN_S = 3_600.0
"""Time for a photograph to arrive before others may take its view again."""
_MOST_REFUSED = 10
"""Number of candidates of a ranking, or plans, that cannot be flown, after which a flight ends."""
_REMEDIES = {
    CandidateStatus.OUT_OF_RANGE: "--radius",
    CandidateStatus.TOO_CLOSE: "--safety",
    CandidateStatus.IN_MATTER: "--generator, --candidates",
    CandidateStatus.UNDER_GROUND: "--generator, --candidates, --terrain",
}
"""The options that change why candidates have no rank."""
_AROUND_M = 100.0
"""How far around the vehicle candidates are compared with the ground; their missions are in any case."""
_BLOCKED = "the way to it from where the vehicle is"


class Choice:
    """Chooses the next views by rankings or plans, and reports visits.

    The candidates are those of the first ranking: generated again, they would be elsewhere, and
    photographed ones could not be recognised.
    """

    def __init__(
        self, scene: Scene, vehicle: Vehicle, settings: FlightSettings, watch: Watch, log: FlightLog
    ) -> None:
        self._scene, self._vehicle, self._settings = scene, vehicle, settings
        self._watch, self._log = watch, log
        self._candidates = settings.candidates
        self._gimbal: MissionSettings = {}
        self._datum = AltitudeDatum.SEA_LEVEL
        self._refused: set[str] = set()

    def limit_gimbal(self, lowest_deg: float, highest_deg: float) -> None:
        """Leave out views beyond the gimbal's limits, unless the settings give these."""
        lowest_deg, highest_deg = (max(-90.0, min(90.0, angle)) for angle in (lowest_deg, highest_deg))
        if lowest_deg < highest_deg:
            self._gimbal = {"gimbal_lowest_deg": lowest_deg, "gimbal_highest_deg": highest_deg}

    def use_datum(self, origin: Origin | None) -> None:
        """Give altitudes in the scene's datum; a scene that is not georeferenced yet will have sea level's.

        Raises ``VehicleError`` where the vehicle's altitudes cannot be converted.
        """
        self._datum = AltitudeDatum.SEA_LEVEL if origin is None else origin.altitude_datum
        if self._datum is AltitudeDatum.ELLIPSOID and "geoid_height_m" not in self._settings.mission:
            raise VehicleError(
                "The scene's altitudes are above the ellipsoid, those of the vehicle above sea level.",
                hint="Give the height of the geoid above the ellipsoid at the site: --geoid METRES.",
            )

    def next(self, photographs: int) -> Leg:
        """The next leg, of at most ``photographs``, whose views are reserved now; raises ``EndedError``."""
        if self._settings.leg_views == 1:
            return self._ranked(photographs)
        return self._planned(min(photographs, self._settings.leg_views))

    def expected_db(self) -> float | None:
        """The PSNR to expect of the model; None while it is unknown."""
        settings = self._settings
        generator = None if isinstance(settings.generator, AroundCurrent) else settings.generator
        plan = self._watch.trying(
            lambda: self._scene.plan(
                settings.candidates, generator=generator, views=1, vehicles=[self._pose()]
            )
        )
        return plan.now.psnr_db

    def report(self, state: VisitState, views: Sequence[Candidate]) -> None:
        """Report visits of the vehicle."""
        if not views:
            return
        settings = self._settings
        going = state is VisitState.GOING_TO
        expires_s = min(86_400, round(settings.leg_s * len(views) if going else _TAKEN_S))
        self._scene.report_visits(settings.vehicle, state, views, expires_in_s=expires_s)

    def _ranked(self, photographs: int) -> Leg:
        """A leg to the first view of a ranking that can be flown to."""
        ranking = self._watch.trying(lambda: self._rank(photographs))
        reason = _unranked(ranking)
        for best in [item for item in ranking.candidates if item.rank is not None][:_MOST_REFUSED]:
            view = Candidate(id=best.id, pose=best.pose)
            try:
                mission = self._watch.trying(partial(self._mission, [view], ranking.origin))
                if (blocked := self._blocked(mission)) is not None:
                    reason = blocked
                    self._leave_out(view.id, reason)
                    continue
                self._watch.trying(partial(self.report, VisitState.GOING_TO, [view]))
            except (ConflictError, InvalidRequestError) as error:  # taken meanwhile, or not to be flown
                reason = error.message
                self._leave_out(view.id, reason)
                continue
            self._log.event(
                "goes",
                f"Goes to {view.id}.",
                self._vehicle.last_state,
                candidate=view.id,
                ranking_id=ranking.id,
            )
            return self._leg(mission, (view,))
        raise EndedError(Ending.NO_VIEW, f"no view can be flown to: {reason}")

    def _planned(self, count: int) -> Leg:
        """A leg through the views of a plan, in its order, without those that cannot be flown."""
        if not self._located:
            self._watch.trying(lambda: self._rank(count))
        out: set[str] = set()
        reason = f"no candidate is within --radius, {self._settings.radius_m} m, of the vehicle."
        for tries_left in reversed(range(_MOST_REFUSED)):
            candidates = tuple(view for view in self._reachable() if view.id not in out)
            if not candidates:
                break
            try:
                plan = self._watch.trying(partial(self._plan, candidates, count))
            except InvalidRequestError as error:  # all of them are photographed, or taken by others
                reason = f"{error.message} {error.hint}".strip()
                break
            tour = plan.tours[0]
            if not tour.stops:
                reason = plan.summary
                break
            try:
                mission = self._watch.trying(partial(self._mission, tour, plan.origin, plan.snapshot_id))
            except InvalidRequestError as error:  # none of them can be flown
                reason = error.message
                for stop in tour.stops:
                    self._leave_out(stop.id, reason)
                out |= {stop.id for stop in tour.stops}
                continue
            reasons = zip_longest(mission.left_out, mission.reasons, fillvalue="it cannot be flown")
            for name, why in reasons:
                self._leave_out(name, f"{why}.")
            out |= set(mission.left_out)
            if mission.left_out and tries_left:
                continue
            if (blocked := self._blocked(mission)) is not None:
                reason = blocked
                first = next(stop.id for stop in tour.stops if stop.id not in mission.left_out)
                self._leave_out(first, reason)
                out.add(first)
                continue
            views = tuple(
                Candidate(id=stop.id, pose=stop.pose)
                for stop in tour.stops
                if stop.id not in mission.left_out
            )
            try:
                self._watch.trying(partial(self.report, VisitState.GOING_TO, views))
            except ConflictError as error:  # another vehicle was faster: the next plan knows
                reason = error.message
                continue
            names = [view.id for view in views]
            text = f"Goes to {', '.join(names)}."
            self._log.event("goes", text, self._vehicle.last_state, candidates=names, length_m=tour.length_m)
            return self._leg(mission, views)
        raise EndedError(Ending.NO_VIEW, f"no view can be flown to: {reason}")

    def _blocked(self, mission: MissionFile) -> str | None:
        """Why the straight path from the vehicle to the first waypoint cannot be flown.

        The service checks the ways between views, and that from home: it does not know where the vehicle is.
        """
        limits, heights = self._settings.mission, self._settings.terrain
        if not self._watch.airborne:
            return None
        here = self._vehicle.last_state
        items = read_waypoints(mission.content.decode())
        first = next(item for item in items[1:] if item.command == Command.WAYPOINT)
        start, end = (here.latitude_deg, here.longitude_deg), (first.x, first.y)
        if "geofence" in limits and Fence.parse(limits["geofence"]).crosses(start, end):
            return f"{_BLOCKED} leaves the geofence."
        if heights is None or first.frame != Frame.RELATIVE:
            return None
        at_home = self._vehicle.home.place
        ground = Ground(heights.around([at_home, start, end]), at_home)
        height_m, place = min(ground.over(start, end, (here.height_m, first.z)))
        if height_m < max(limits.get("lowest_height_m", 0.0), 0.0):
            return f"{_BLOCKED} is too low over {described(place)}: {height_m:.1f} m above the ground."
        return None

    @property
    def _located(self) -> bool:
        """Whether the distances of all candidates are known, where that matters."""
        if self._candidates is None:
            return False
        return self._radius_m is None or all(isinstance(view.pose, VehiclePose) for view in self._candidates)

    def _leave_out(self, name: str, reason: str) -> None:
        """Report once that a view is left out."""
        if name not in self._refused or self._settings.leg_views == 1:
            self._log.event(
                "refused", f"{name} is left out: {reason}", self._vehicle.last_state, candidate=name
            )
        self._refused.add(name)

    def _rank(self, photographs: int) -> Ranking:
        settings = self._settings
        generator = settings.generator if self._candidates is None else None
        ranking = self._scene.rank(
            self._candidates,
            generator=generator,
            current_pose=self._pose(),
            radius_m=self._radius_m,
            safety_m=settings.safety_m,
            terrain=self._surface(),
            method=settings.method,
            budget=max(1, photographs),
            for_vehicle=settings.vehicle,
        )
        if not isinstance(settings.generator, AroundCurrent):
            self._candidates = tuple(
                Candidate(id=item.id, pose=item.pose)
                for item in ranking.candidates
                if item.status is not CandidateStatus.UNDER_GROUND
            )
        return ranking

    def _plan(self, candidates: Sequence[Candidate], count: int) -> Plan:
        settings = self._settings
        return self._scene.plan(
            candidates,
            views=count,
            vehicles=[self._pose()],
            safety_m=settings.safety_m,
            for_vehicle=settings.vehicle,
        )

    def _reachable(self) -> Iterator[Candidate]:
        """The candidates within the radius of the vehicle."""
        here, radius_m = self._vehicle.last_state, self._radius_m
        for view in self._candidates or ():
            pose = view.pose
            if radius_m is None or not isinstance(pose, VehiclePose):
                yield view
                continue
            place = pose.latitude_deg, pose.longitude_deg
            away_m = apart_m((here.latitude_deg, here.longitude_deg), place)
            up_m = pose.altitude_m - self._altitude_m(here.altitude_m, here.height_m)
            if math.hypot(away_m, up_m) <= radius_m:
                yield view

    def _mission(
        self, views: Tour | Sequence[Candidate], origin: Origin | None, snapshot_id: str | None = None
    ) -> MissionFile:
        """The mission through views, as a waypoint file; of a plan, those that can be flown."""
        home = self._vehicle.home
        given: MissionSettings = {
            "home_latitude_deg": home.latitude_deg,
            "home_longitude_deg": home.longitude_deg,
            "takeoff": not self._watch.airborne,
            "autopilot": self._vehicle.dialect.autopilot,
            "leave_out": isinstance(views, Tour),
        }
        if origin is not None:
            given["home_altitude_m"] = self._altitude_m(home.altitude_m, 0.0)
        given |= self._gimbal
        given |= self._settings.mission
        return self._scene.mission(
            views,
            MissionFormat.QGC_WPL,
            snapshot_id=snapshot_id,
            terrain=self._terrain(views, origin),
            **given,
        )

    def _terrain(self, views: Tour | Sequence[Candidate], origin: Origin | None) -> Terrain | None:
        """The ground around home and the views, and the ways to them."""
        heights = self._settings.terrain
        if heights is None:
            return None
        poses = [view.pose for view in (views.stops if isinstance(views, Tour) else views)]
        if isinstance(views, Tour):
            poses += [pose for stop in views.stops for pose in stop.via] + list(views.via_home)
        here = self._vehicle.last_state
        places = [self._vehicle.home.place, (here.latitude_deg, here.longitude_deg)]
        return heights.around([*places, *places_of(poses, origin)])

    def _surface(self) -> Terrain | None:
        """The ground around the vehicle, at the altitudes of the scene."""
        heights, home, here = self._settings.terrain, self._vehicle.home, self._vehicle.last_state
        if heights is None:
            return None
        at_home = home.place
        terrain = heights.around([at_home, (here.latitude_deg, here.longitude_deg)], _AROUND_M)
        home_m = terrain.height_m(at_home)
        if home_m is None:
            raise VehicleError(f"The height model has no height at home, {described(at_home)}.")
        return terrain.raised(self._altitude_m(home.altitude_m, 0.0) - home_m, self._datum)

    def _leg(self, mission: MissionFile, views: tuple[Candidate, ...]) -> Leg:
        items = read_waypoints(mission.content.decode())
        return Leg(holding(items, self._settings.patience_s), views)

    @property
    def _radius_m(self) -> float | None:
        """The maximum distance of views from the vehicle: none from home, where it begins."""
        return self._settings.radius_m if self._watch.airborne else None

    def _altitude_m(self, above_sea_m: float, above_home_m: float) -> float:
        """An altitude in the scene's datum."""
        match self._datum:
            case AltitudeDatum.TAKEOFF:
                return above_home_m
            case AltitudeDatum.ELLIPSOID:
                return above_sea_m + self._settings.mission["geoid_height_m"]
            case AltitudeDatum.SEA_LEVEL:
                return above_sea_m

    def _pose(self) -> VehiclePose:
        state = self._vehicle.last_state
        return VehiclePose(
            latitude_deg=state.latitude_deg,
            longitude_deg=state.longitude_deg,
            altitude_m=self._altitude_m(state.altitude_m, state.height_m),
            altitude_datum=self._datum,
            yaw_deg=0.0 if math.isnan(state.yaw_deg) else state.yaw_deg,
            pitch_deg=0.0,
        )


def _unranked(ranking: Ranking) -> str:
    """Why no candidate has a rank: how many have which status, and the options that change it."""
    counts = Counter(item.status for item in ranking.candidates)
    reasons = [
        f"{count} {status.value}" + (f" ({_REMEDIES[status]})" if status in _REMEDIES else "")
        for status, count in counts.most_common()
    ]
    return f"none of {len(ranking.candidates)} candidates has a rank: {', '.join(reasons)}."
