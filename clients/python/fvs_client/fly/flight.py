"""A flight: request views, fly there, photograph them, send the photographs, update the model, repeat.

Each mission ends at home. After a leg the vehicle waits for the next one; when none comes in time, because
the service, the link or this program is gone, it returns by itself. In a pause it flies none: if the link
breaks then, its own failsafe decides.
"""

import contextlib
import math
import threading
import time
from collections.abc import Callable, Sequence

from fvs_client import ConflictError, FvsError, Job, Scene, VisitState
from fvs_client.fly.checklist import Check, checklist
from fvs_client.fly.choice import Choice
from fvs_client.fly.dialects import Mode
from fvs_client.fly.equipment import require_battery, require_equipment, try_camera
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.ground import Ground
from fvs_client.fly.homecoming import Homecoming
from fvs_client.fly.items import after, holding, resumes_at
from fvs_client.fly.leg import Leg
from fvs_client.fly.log import FlightLog
from fvs_client.fly.photographs import Photographs
from fvs_client.fly.places import Home
from fvs_client.fly.settings import EndedError, Ending, FlightResult, FlightSettings
from fvs_client.fly.shots import Shots
from fvs_client.fly.start import HomeMovedError, require_home, require_near
from fvs_client.fly.survey import Survey
from fvs_client.fly.survey_limits import require_within_limits
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.vehicle import Vehicle
from fvs_client.fly.watch import POLL_S, Control, Watch
from fvs_schema.fence import Fence

__all__ = ["Ending", "Flight", "FlightResult", "FlightSettings"]

_TRACK_S = 0.5
_RECOVER_S = 1.0
_TRIES = 3
_MOST_FAILED = 3
"""Number of photographs that fail in a row after which a flight ends."""


class Flight:
    """One flight of a vehicle for a scene; ``return_home``, ``pause`` and ``resume`` work at any time.

    ``confirm`` gets the checklist before takeoff; where it returns False, the vehicle stays on the ground.
    """

    def __init__(
        self,
        scene: Scene,
        vehicle: Vehicle,
        photographs: Photographs,
        settings: FlightSettings,
        log: FlightLog,
        confirm: Callable[[Sequence[Check]], bool] = lambda _checks: True,
    ) -> None:
        self._scene, self._vehicle, self._confirm = scene, vehicle, confirm
        self._photographs, self._settings, self._log = photographs, settings, log
        self._watch = Watch(vehicle, settings, log)
        self._choice = Choice(scene, vehicle, settings, self._watch, log)
        self._commanding = threading.Lock()
        """Held while commands change the vehicle's mode or mission: acknowledgements belong to one thread."""
        self._over = False
        self._leg = Leg([])
        """What is flown, or was last."""
        self._unreported = Leg([])
        """The leg whose visits are not reported yet."""
        self._next_track_s = 0.0
        self._failed_in_row = 0
        self._shots = Shots(vehicle, photographs, settings.photographs, log)

    def return_home(self) -> None:
        """End the flight: the vehicle returns home now."""
        self._watch.asked_home.set()

    def pause(self) -> None:
        """Stop the vehicle where it is, until ``resume``; the battery's reserve still sends it home.

        Before takeoff it stays on the ground. Raises ``VehicleError`` when it does not stop, or the flight
        has ended.
        """
        self._watch.paused.set()
        with self._commanding:
            self._require_flight()
            if self._watch.airborne and self._watch.control(self._vehicle.state) is Control.OURS:
                with self._watch.commanding(Mode.PAUSE):
                    self._vehicle.pause()

    def resume(self) -> None:
        """Resume after ``pause``, from where the gimbal turns. Raises ``VehicleError`` as ``pause`` does."""
        if self._watch.paused.is_set():
            with self._commanding:
                self._require_flight()
                state = self._vehicle.state
                if self._watch.airborne and self._watch.control(state) is Control.OURS:
                    with self._watch.commanding(Mode.MISSION):
                        self._vehicle.resume(resumes_at(self._watch.items, state.item))
                    self._watch.resumes()
                self._watch.paused.clear()

    def _require_flight(self) -> None:
        if self._over:
            raise VehicleError("The flight has ended: the vehicle gets no more commands of it.")

    def fly(self) -> FlightResult:
        """Fly until the flight ends, send the vehicle home and wait until it has landed.

        The result's ending is ``VEHICLE`` when the landing was not seen, and ``PILOT`` when somebody else has
        taken over: then the vehicle gets no more commands. Raises other failures, such as ``SpoolError``,
        after the landing.
        """
        failure: Exception | None = None
        try:
            self._check()
            if self._settings.take_over:
                self._watch.take_over()
            self._survey()
            while True:
                self._update()
                self._require_more()
                self._next_leg()
        except EndedError as ended:
            ending, reason = ended.ending, ended.reason
        except VehicleError as error:
            ending, reason = Ending.VEHICLE, f"{error.message} {error.hint}".strip()
        except FvsError as error:
            ending, reason = Ending.SERVICE, f"{error.message} {error.hint}".strip()
        except Exception as error:  # whatever it is: the vehicle comes home first
            failure, ending, reason = error, Ending.FAILED, f"{type(error).__name__}: {error}"
        self._log.event("ends", f"The flight ends: {reason}", ending=ending.value)
        with self._commanding:
            self._over = True
        if ending is not Ending.PILOT:
            try:
                Homecoming(self._vehicle, self._watch, self._settings, self._log).wait()
            except EndedError as ended:
                ending, reason = ended.ending, f"{reason} {ended.reason}"
        if failure is not None:
            raise failure
        self._wait_for_files()
        return FlightResult(ending, reason, self._shots.taken, self._shots.failed, self._photographs.left)

    def _wait_for_files(self) -> None:
        """Wait until the photographs that were reported have come and are sent."""
        until_s = time.monotonic() + self._settings.send_s
        state = self._vehicle.last_state
        reported = self._shots.reported
        self._shots.collect(state)
        while any(not (shot.arrived or shot.failed) for shot in reported) and time.monotonic() < until_s:
            time.sleep(POLL_S)
            self._shots.collect(state)
        self._shots.close(reported, state)
        with contextlib.suppress(FvsError):  # a report that is lost expires
            self._report()
        self._photographs.wait(self._shots.taken, max(0.0, until_s - time.monotonic()))

    def _check(self) -> None:
        """Go through the checklist. Raises ``VehicleError`` for a vehicle without the required equipment."""
        self._watch.require_going_on()
        equipment = self._vehicle.equipment()
        require_equipment(equipment, self._settings)
        if equipment.gimbal_deg is not None:
            self._choice.limit_gimbal(*equipment.gimbal_deg)
        require_battery(self._vehicle, self._settings, self._log)
        if self._settings.upload_fence:
            self._vehicle.replace_fence(Fence.parse(self._settings.mission["geofence"]))
            self._log.event("fence", "The vehicle's own fence is --geofence now.", self._vehicle.last_state)
        self._photographs.test()
        camera = try_camera(self._vehicle, equipment, self._photographs, self._watch.require_going_on)
        checks = checklist(self._vehicle, self._settings, equipment, camera)
        for check in checks:
            self._log.event("check", str(check), what=check.what, fine=check.fine)
        if not self._confirm(checks):
            raise EndedError(Ending.STOPPED, "the checklist was not confirmed.")
        self._vehicle.captures()  # of the test photograph

    def _survey(self) -> None:
        """Fly the first photographs, if the scene has no model."""
        scene = self._watch.trying(self._scene.refresh)
        self._choice.use_datum(scene.origin)
        if scene.snapshot_id is not None:
            return
        survey = self._settings.survey
        if survey is None:
            raise EndedError(
                Ending.NO_VIEW, "the scene has no model: send photographs first, or fly a survey (--survey)."
            )
        self._fly(lambda: self._survey_leg(survey))

    def _survey_leg(self, survey: Survey) -> Leg:
        home, ground, heights = self._vehicle.home.place, None, self._settings.terrain
        if heights is not None:
            middle = survey.latitude_deg, survey.longitude_deg
            ground = Ground(heights.around([home, middle, *survey.places]), home)
        require_within_limits(survey, home, self._settings.mission, ground)
        self._log.event("survey", f"Survey: {survey.count} photographs.", self._vehicle.last_state)
        return Leg(holding(survey.items(self._vehicle.dialect, home, ground), self._settings.patience_s))

    def _update(self) -> None:
        """Have all photographs registered and the model trained; the vehicle waits meanwhile."""
        photographs, watch = self._shots.taken, self._watch
        while not self._photographs.wait(photographs, POLL_S * 5):
            watch.require_going_on()
            if time.monotonic() > watch.deadline_s:
                break
        try:
            job = watch.trying(self._job)
            while not job.ended:
                watch.require_going_on()
                watch.require_in_time()
                time.sleep(POLL_S * 5)
                job = watch.trying(job.refresh)
        except ConflictError:  # there is nothing new
            return
        if job.snapshot_id is None:
            why = "" if job.error is None else f" {job.error.message}"
            self._log.event("model", f"The update made no model.{why}", self._vehicle.last_state)
        else:
            snapshot = watch.trying(job.snapshot)
            count = 0 if snapshot is None else snapshot.metrics.registered
            accepted = watch.trying(self._scene.refresh).image_counts.accepted
            text = f"The model has {count} of the scene's {accepted} photographs."
            self._log.event("model", text, self._vehicle.last_state, snapshot_id=job.snapshot_id)

    def _job(self) -> Job:
        if self._scene.refresh().snapshot_id is not None:
            return self._scene.update()
        settings = self._settings
        return self._scene.update(iterations=settings.iterations, long_side_px=settings.long_side_px)

    def _require_more(self) -> None:
        """Raise ``EndedError`` when enough photographs are taken, or the model is good enough."""
        settings = self._settings
        if self._shots.taken >= settings.photographs:
            raise EndedError(Ending.BUDGET, f"all {self._shots.taken} photographs are taken.")
        if settings.stop_at_db is None:
            return
        expected_db = self._choice.expected_db()
        if expected_db is not None and expected_db >= settings.stop_at_db:
            raise EndedError(Ending.GOOD_ENOUGH, f"{expected_db:.1f} dB are to be expected.")

    def _next_leg(self) -> None:
        """Request views, fly there and photograph them."""
        photographs = self._settings.photographs - self._shots.taken
        leg = self._fly(lambda: self._choice.next(photographs))
        self._watch.trying(self._report)
        self._failed_in_row = 0 if leg.succeeded else self._failed_in_row + len(leg.views)
        if self._failed_in_row >= _MOST_FAILED:
            raise EndedError(Ending.CAMERA, f"the camera failed {self._failed_in_row} times in a row.")

    def _report(self) -> None:
        """Report what became of the views of the last leg, and those whose photographs came late."""
        self._choice.report(VisitState.TAKEN, [*self._unreported.succeeded, *self._shots.late])
        self._shots.late.clear()
        self._choice.report(VisitState.FAILED, self._unreported.left)
        self._unreported = Leg([])

    def _fly(self, make: Callable[[], Leg]) -> Leg:
        """Fly what ``make`` returns, unless the flight is paused, and wait for its photographs.

        It is made again where home moves when the vehicle arms.
        """
        for tries_left in reversed(range(_TRIES)):
            home, last = self._vehicle.home, self._leg
            leg = self._unreported = make()
            if self._watch.airborne and self._watch.items and self._vehicle.dialect.replaces_items:
                leg.put(*after(leg.items, last.items, last.waits_at))
            try:
                self._start(leg, home)
                self._leg = leg
                self._take(leg)
                break
            except (EndedError, VehicleError) as error:
                if isinstance(error, HomeMovedError) and tries_left:
                    text = f"{error.message} The mission is made again."
                    self._log.event("home", text, self._vehicle.last_state)
                    continue
                raise
        return leg

    def _start(self, leg: Leg, home: Home) -> None:
        """Begin a leg, after a pause, and again where answers are lost."""
        for tries_left in reversed(range(_TRIES)):
            self._watch.require_going_on()  # waits for a vehicle that is silent; without the lock
            try:
                while not self._begin(leg, home):
                    self._watch.wait_while_paused()
                return
            except NoAnswerError:  # the link may come back: the mission is sent again then
                if not tries_left:
                    raise

    def _begin(self, leg: Leg, home: Home) -> bool:
        """Replace the vehicle's mission and begin it; False when it is paused."""
        vehicle, watch = self._vehicle, self._watch
        with self._commanding:
            state = watch.require_going_on()
            if watch.paused.is_set():
                return False
            require_near(leg.items, state, home, self._settings.mission)
            self._shots.collect(state)  # late reports belong to the leg before
            vehicle.upload(leg.items)
            watch.items = leg.items
            watch.require_going_on()  # that took time: it may return by now
            began = state.armed and state.mode is Mode.MISSION  # and only the answer was lost
            if not (watch.airborne or began):
                watch.starting = True
                with watch.commanding(Mode.HOLD):
                    vehicle.arm()
                require_home(vehicle, home)
                watch.require_going_on()
            self._photographs.begin()
            with watch.commanding(Mode.MISSION):
                vehicle.begin(leg.first, leg.waits_at)
            watch.flies(leg.way)
        return True

    def _take(self, leg: Leg) -> None:
        """Wait for the photographs of a leg, until the vehicle waits at the end of the mission.

        The folder decides: a photograph is taken when its file has come, and did not come when neither a
        report nor a file was new for a while.
        """
        settings, count, waits_at = self._settings, leg.count, leg.waits_at
        late_s, waits_s, asked_s = math.inf, math.inf, 0.0
        until_s = time.monotonic() + settings.leg_s * count
        self._shots.add(leg.shots)
        while True:
            began_s = time.monotonic()
            state = self._watch.require_going_on()
            now = time.monotonic()
            until_s += now - began_s  # it may have waited for a vehicle that was silent
            self._track(state)
            leg.reach(state.item, now)
            if self._shots.collect(state):
                late_s = math.inf
            if leg.settled:
                break
            if self._watch.paused.is_set():
                until_s = max(until_s, now + settings.leg_s)
            elif state.item >= waits_at:
                waits_s = min(waits_s, now)
                late_s = min(late_s, now + settings.photograph_s)
                if not all(shot.reported for shot in leg.shots) and now > asked_s + _RECOVER_S:
                    asked_s = now
                    self._vehicle.recover_captures()
            if now > late_s:
                break
            if now > until_s:
                raise EndedError(
                    Ending.VEHICLE, f"the vehicle is not there after {settings.leg_s * count:.0f} s."
                )
            time.sleep(POLL_S)
        self._shots.close(leg.shots, state)
        self._watch.deadline_s = min(waits_s, time.monotonic()) + settings.patience_s

    def _track(self, state: VehicleState) -> None:
        """Log the vehicle's position at intervals."""
        if time.monotonic() >= self._next_track_s:
            self._next_track_s = time.monotonic() + _TRACK_S
            self._log.event("position", "", state)
