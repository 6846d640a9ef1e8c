"""A flight: ask for the next view, fly there, photograph it, send it, update the model, ask again.

The vehicle always has a mission that ends at home. After each photograph it waits for the next mission; when
none comes in time, because the service, the link or this program is gone, it returns by itself.
"""

import math
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum
from functools import partial
from typing import TypeVar

from fvs_client import (
    AltitudeDatum,
    Candidate,
    ConflictError,
    FvsError,
    InvalidRequestError,
    Job,
    NoSnapshotError,
    Ranking,
    Scene,
    VehiclePose,
    VisitState,
)
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import Command, MissionItem, holding, read_waypoints
from fvs_client.fly.log import FlightLog
from fvs_client.fly.photographs import Photographs
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Capture, Mode, Vehicle, VehicleState
from fvs_client.models.missions import MissionFormat, MissionSettings
from fvs_client.models.rankings import AroundCurrent, Generator
from fvs_client.models.scenes import Origin

T = TypeVar("T")

_POLL_S = 0.1
_RETRY_S = 2.0
_TRACK_S = 0.5
_TAKEN_S = 3_600.0
"""How long a photograph may be on its way before others may take it again."""
_MOST_REFUSED = 10
"""Candidates of a ranking that cannot be flown to, after which a flight ends."""
_MOST_FAILED = 3
"""Photographs in a row that fail, after which a flight ends."""


class Ending(StrEnum):
    """Why a flight ended."""

    BUDGET = "budget"
    """All photographs are taken."""
    BATTERY = "battery"
    STOPPED = "stopped"
    """It was asked to return home."""
    GOOD_ENOUGH = "good-enough"
    """The expected PSNR has reached its goal."""
    NO_VIEW = "no-view"
    """No candidate can be flown to."""
    CAMERA = "camera"
    """The camera brings no photographs."""
    SERVICE = "service"
    """The service could not be reached, or made no model, until the vehicle had to return."""
    VEHICLE = "vehicle"
    """The vehicle refused something, or returned by itself."""


@dataclass(frozen=True)
class FlightSettings:
    """What to fly, and when to stop."""

    vehicle: str
    """The vehicle's name, by which others leave its views out."""
    photographs: int
    """How many, with those of the survey."""
    method: str = "median-frequency"
    generator: Generator | None = None
    candidates: tuple[Candidate, ...] | None = None
    radius_m: float | None = None
    """Only views so near to the vehicle."""
    survey: Survey | None = None
    """The first photographs, for a scene without a model."""
    reserve: float = 0.3
    """The share of the battery with which it returns home."""
    patience_s: float = 300.0
    """How long the vehicle waits for the next mission before it returns home."""
    photograph_s: float = 60.0
    """How long a photograph may take, once the vehicle is there."""
    leg_s: float = 600.0
    """How long the way to a view may take."""
    send_s: float = 60.0
    """How long photographs may still be sent after the landing."""
    iterations: int | None = None
    """Training iterations of the scene's first update; by default the service's."""
    long_side_px: int | None = None
    """To which the first update reduces photographs; by default the service's."""
    stop_at_db: float | None = None
    """Stop when so much PSNR is to be expected of the model."""
    mission: MissionSettings = field(default_factory=lambda: MissionSettings())
    """Options of the missions, such as ``transit_height_m`` and ``geofence``."""


@dataclass(frozen=True)
class FlightResult:
    """What a flight was: its photographs, those that failed, and why it ended."""

    ending: Ending
    reason: str
    photographs: int
    failed: int
    unsent: int
    """Photographs that the service has not acknowledged yet: they wait in the outbox."""


class _Ended(Exception):  # noqa: N818 - no error
    """The flight is over."""

    def __init__(self, ending: Ending, reason: str) -> None:
        super().__init__(reason)
        self.ending, self.reason = ending, reason


class Flight:
    """One flight of a vehicle for a scene; ``return_home``, ``pause`` and ``resume`` work at any time."""

    def __init__(
        self,
        scene: Scene,
        vehicle: Vehicle,
        photographs: Photographs,
        settings: FlightSettings,
        log: FlightLog,
    ) -> None:
        self._scene, self._vehicle = scene, vehicle
        self._photographs, self._settings, self._log = photographs, settings, log
        self._home: VehicleState = vehicle.state
        self._asked_home = threading.Event()
        self._paused = threading.Event()
        self._airborne = False
        self._next_track_s = 0.0
        self._candidates = settings.candidates
        self._taken = self._failed = self._failed_in_row = 0
        self._deadline_s = math.inf
        """When the vehicle begins to return by itself, on the monotonic clock."""

    def return_home(self) -> None:
        """End the flight: the vehicle returns home now."""
        self._asked_home.set()

    def pause(self) -> None:
        """Stop the vehicle where it is, until ``resume``; the battery's reserve still sends it home."""
        self._paused.set()
        self._vehicle.pause()

    def resume(self) -> None:
        """Go on after ``pause``."""
        if self._paused.is_set():
            self._vehicle.resume()
            self._paused.clear()

    def fly(self) -> FlightResult:
        """Fly until the flight ends. The vehicle has landed then, or is silent and returns by itself."""
        try:
            self._survey()
            while True:
                self._update()
                self._require_more()
                self._next_view()
        except _Ended as ended:
            ending, reason = ended.ending, ended.reason
        except VehicleError as error:
            ending, reason = Ending.VEHICLE, error.message
        except FvsError as error:
            ending, reason = Ending.SERVICE, f"{error.message} {error.hint}".strip()
        self._log.event("ends", f"The flight ends: {reason}", ending=ending.value)
        self._go_home()
        self._photographs.wait(self._taken, self._settings.send_s)
        return FlightResult(ending, reason, self._taken, self._failed, self._photographs.left)

    def _survey(self) -> None:
        """Fly the first photographs, if the scene has no model."""
        if self._trying(self._scene.refresh).snapshot_id is not None:
            return
        survey = self._settings.survey
        if survey is None:
            raise _Ended(
                Ending.NO_VIEW, "the scene has no model: send photographs first, or fly a survey (--survey)."
            )
        items = holding(survey.items(), self._settings.patience_s)
        self._log.event("survey", f"Survey: {survey.count} photographs.", self._vehicle.state)
        self._begin(items)
        self._take(items, survey.count)

    def _update(self) -> None:
        """Have all photographs registered and the model trained; the vehicle waits meanwhile."""
        photographs = self._taken
        until = time.monotonic() + max(0.0, self._deadline_s - time.monotonic())
        while not self._photographs.wait(photographs, _POLL_S * 5):
            self._require_going_on()
            if time.monotonic() > until:
                break
        try:
            job = self._trying(self._job)
            while not job.ended:
                self._require_going_on()
                time.sleep(_POLL_S * 5)
                job = self._trying(job.refresh)
        except ConflictError:  # there is nothing new
            return
        if job.snapshot_id is None:
            why = "" if job.error is None else f" {job.error.message}"
            self._log.event("model", f"The update made no model.{why}", self._vehicle.state)
        else:
            snapshot = self._trying(job.snapshot)
            count = 0 if snapshot is None else snapshot.metrics.registered
            text = f"The model has {count} of {photographs} photographs."
            self._log.event("model", text, self._vehicle.state, snapshot_id=job.snapshot_id)

    def _job(self) -> Job:
        if self._scene.refresh().snapshot_id is not None:
            return self._scene.update()
        settings = self._settings
        return self._scene.update(iterations=settings.iterations, long_side_px=settings.long_side_px)

    def _require_more(self) -> None:
        """Raise ``_Ended`` when enough photographs are taken, or the model is good enough."""
        settings = self._settings
        if self._taken >= settings.photographs:
            raise _Ended(Ending.BUDGET, f"all {self._taken} photographs are taken.")
        if settings.stop_at_db is None:
            return
        plan = self._trying(
            lambda: self._scene.plan(
                settings.candidates, generator=_planned(settings.generator), views=1, vehicles=[self._pose()]
            )
        )
        expected_db = plan.now.psnr_db
        if expected_db is not None and expected_db >= settings.stop_at_db:
            raise _Ended(Ending.GOOD_ENOUGH, f"{expected_db:.1f} dB are to be expected.")

    def _next_view(self) -> None:
        """Ask for a view, fly there and photograph it."""
        view, items, ranking_id = self._ask()
        text = f"Goes to {view.id}."
        self._log.event("goes", text, self._vehicle.state, candidate=view.id, ranking_id=ranking_id)
        self._begin(items)
        before = self._taken
        self._take(items, 1)
        succeeded = self._taken > before
        self._trying(lambda: self._report(VisitState.TAKEN if succeeded else VisitState.FAILED, view))
        self._failed_in_row = 0 if succeeded else self._failed_in_row + 1
        if self._failed_in_row >= _MOST_FAILED:
            raise _Ended(Ending.CAMERA, f"the camera failed {self._failed_in_row} times in a row.")

    def _ask(self) -> tuple[Candidate, list[MissionItem], str]:
        """The next view that can be flown to, now reserved, the mission to it, and the ranking's id."""
        ranking = self._trying(self._rank)
        ranked = [item for item in ranking.candidates if item.rank is not None]
        reason = "no candidate has a rank."
        for best in ranked[:_MOST_REFUSED]:
            view = Candidate(id=best.id, pose=best.pose)
            try:
                mission = self._trying(partial(self._mission, view, ranking.origin))
                self._trying(partial(self._report, VisitState.GOING_TO, view))
            except (ConflictError, InvalidRequestError) as error:  # taken meanwhile, or not to be flown
                reason = error.message
                self._log.event("refused", f"{view.id} is left out: {reason}", self._vehicle.state)
                continue
            return view, holding(read_waypoints(mission), self._settings.patience_s), ranking.id
        raise _Ended(Ending.NO_VIEW, f"no view can be flown to: {reason}")

    def _rank(self) -> Ranking:
        settings = self._settings
        ranking = self._scene.rank(
            self._candidates,
            generator=settings.generator if self._candidates is None else None,
            current_pose=self._pose(),
            radius_m=settings.radius_m,
            method=settings.method,
            budget=max(1, settings.photographs - self._taken),
            for_vehicle=settings.vehicle,
        )
        if not isinstance(settings.generator, AroundCurrent):
            # Generated again, they would be elsewhere: those that were photographed could not be told.
            self._candidates = tuple(Candidate(id=item.id, pose=item.pose) for item in ranking.candidates)
        return ranking

    def _mission(self, view: Candidate, origin: Origin | None) -> str:
        """The mission to a view, as a waypoint file."""
        home = self._home
        given: MissionSettings = {
            "home_latitude_deg": home.latitude_deg,
            "home_longitude_deg": home.longitude_deg,
            "takeoff": not self._airborne,
        }
        datum = None if origin is None else origin.altitude_datum
        if datum is AltitudeDatum.TAKEOFF:
            given["home_altitude_m"] = 0.0
        elif datum is AltitudeDatum.SEA_LEVEL:
            given["home_altitude_m"] = home.altitude_m - home.height_m
        given |= self._settings.mission
        return self._scene.mission([view], MissionFormat.QGC_WPL, **given).content.decode()

    def _report(self, state: VisitState, view: Candidate) -> None:
        settings = self._settings
        expires_s = round(settings.leg_s if state is VisitState.GOING_TO else _TAKEN_S)
        self._scene.report_visits(settings.vehicle, state, [view], expires_in_s=expires_s)

    def _begin(self, items: list[MissionItem]) -> None:
        """Give the vehicle a mission, and let it fly it."""
        self._require_going_on()
        if self._airborne:
            self._vehicle.hold()
        self._vehicle.captures()  # what came late belongs to the view before
        self._vehicle.upload(items)
        self._vehicle.fly()
        self._airborne = True
        self._deadline_s = math.inf

    def _take(self, items: list[MissionItem], count: int) -> None:
        """Wait for ``count`` photographs, until the vehicle waits at the end of the mission."""
        waits_at = next(number for number, item in enumerate(items) if item.command == Command.LOITER_TIME)
        settings, seen, late_s = self._settings, 0, math.inf
        until_s = time.monotonic() + settings.leg_s * count
        while seen < count:
            self._require_going_on()
            state = self._vehicle.state
            self._track(state)
            for capture in self._vehicle.captures():
                seen += 1
                self._captured(capture, state)
            if self._paused.is_set():
                until_s = max(until_s, time.monotonic() + settings.leg_s)
            elif state.item >= waits_at and math.isinf(late_s):
                late_s = time.monotonic() + settings.photograph_s
            if seen < count and time.monotonic() > late_s:
                self._failed += count - seen
                text = f"{count - seen} photographs did not come."
                self._log.event("failed", text, state)
                break
            if time.monotonic() > until_s:
                raise _Ended(
                    Ending.VEHICLE, f"the vehicle is not there after {settings.leg_s * count:.0f} s."
                )
            time.sleep(_POLL_S)
        self._deadline_s = time.monotonic() + settings.patience_s

    def _track(self, state: VehicleState) -> None:
        """Log where the vehicle is, now and then."""
        if time.monotonic() >= self._next_track_s:
            self._next_track_s = time.monotonic() + _TRACK_S
            self._log.event("position", "", state)

    def _captured(self, capture: Capture, state: VehicleState) -> None:
        if capture.succeeded:
            self._taken += 1
            text = f"Photograph {self._taken} of {self._settings.photographs}."
            self._log.event("photograph", text, state, file=capture.file)
        else:
            self._failed += 1
            self._log.event("failed", "The camera reports a failure.", state)

    def _trying(self, call: Callable[[], T]) -> T:
        """Call the service, again while it cannot be reached and the vehicle can wait."""
        said = ""
        while True:
            try:
                return call()
            except FvsError as error:
                if isinstance(error, VehicleError) or not error.retryable:
                    raise
                if isinstance(error, NoSnapshotError):
                    raise _Ended(Ending.SERVICE, f"{error.message} {error.hint}") from error
                if error.message != said:
                    said = error.message
                    self._log.event("service", f"{said} Trying again.", self._vehicle.state)
                until = time.monotonic() + _RETRY_S
                while time.monotonic() < until:
                    self._require_going_on()
                    time.sleep(_POLL_S)
                if time.monotonic() > self._deadline_s:
                    raise _Ended(Ending.SERVICE, f"the service is away: {error.message}") from error

    def _require_going_on(self) -> None:
        """Raise ``_Ended`` when the vehicle must return, or does."""
        state = self._vehicle.state
        if self._asked_home.is_set():
            raise _Ended(Ending.STOPPED, "it was asked to return home.")
        if not self._airborne:
            return
        if state.battery is not None and state.battery <= self._settings.reserve:
            raise _Ended(Ending.BATTERY, f"the battery is at {state.battery:.0%}.")
        if state.mode in (Mode.RETURN, Mode.LAND):
            raise _Ended(Ending.VEHICLE, f"the vehicle returns by itself{self._says()}.")
        if not state.armed:
            raise _Ended(Ending.VEHICLE, f"the vehicle has landed{self._says()}.")

    def _says(self) -> str:
        return f" (it says: {texts[-1]})" if (texts := self._vehicle.texts) else ""

    def _go_home(self) -> None:
        """Send the vehicle home, and wait until it has landed."""
        if not self._airborne:
            return
        try:
            if self._vehicle.state.armed and self._vehicle.state.mode not in (Mode.RETURN, Mode.LAND):
                self._vehicle.return_home()
            self._vehicle.wait(lambda: not self._vehicle.state.armed, self._settings.leg_s, "does not land")
            self._log.event("landed", "The vehicle has landed.", self._vehicle.state)
        except VehicleError as error:
            self._log.event("lost", f"{error.message} {error.hint}")

    def _pose(self) -> VehiclePose:
        state = self._vehicle.state
        return VehiclePose(
            latitude_deg=state.latitude_deg,
            longitude_deg=state.longitude_deg,
            altitude_m=state.altitude_m,
            yaw_deg=0.0 if math.isnan(state.yaw_deg) else state.yaw_deg,
            pitch_deg=0.0,
        )


def _planned(generator: Generator | None) -> Generator | None:
    """The candidates of a plan: one from a place alone has none."""
    return None if isinstance(generator, AroundCurrent) else generator
