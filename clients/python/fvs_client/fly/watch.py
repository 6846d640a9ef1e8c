"""Supervision of a flight: who commands the vehicle, whether it may continue, is silent, or must return."""

import math
import re
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future, wait
from contextlib import contextmanager
from enum import Enum, auto
from typing import TypeVar

from fvs_client import FvsError, NoSnapshotError
from fvs_client.fly.dialects import Mode
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.items import Command, MissionItem
from fvs_client.fly.link import STOOD_STILL_S
from fvs_client.fly.log import FlightLog
from fvs_client.fly.places import off_m
from fvs_client.fly.settings import EndedError, Ending, FlightSettings
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.vehicle import Vehicle
from fvs_schema.fence import Place

T = TypeVar("T")

POLL_S = 0.1
_RETRY_S = 2.0
_RETURNING = (Mode.RETURN, Mode.LAND)
_FAILSAFE = re.compile(
    r"failsafe|breach|no valid mission|battery.*(low|critical|empty)|variance|glitch|dead reckoning|crash|"
    r"\blost\b",
    re.IGNORECASE,
)
"""Texts of ArduCopter and PX4 that say why they change the mode by themselves."""
_NO_CAUSE = ("Failsafe activated", "Battery Failsafe")
"""Texts without the cause: PX4's only events name it; ArduCopter has told the voltage before."""
_UPLOADS = "Auto mission changed"
"""ArduCopter tells uploads, ours as well."""
_FAILSAFE_S = 10.0
_HOME_M = 2.0
_OFF_M = 30.0
_IN_THE_AIR_M = 1.0


class Control(Enum):
    """Who commands the vehicle."""

    OURS = auto()
    """It is in a mode that this flight has commanded."""
    RETURNING = auto()
    """It returns or lands, whoever has commanded it: it gets no command."""
    LANDED = auto()
    OTHERS = auto()
    """It is in another mode: a pilot, a ground station or a failsafe has taken over. It gets no command."""


class Watch:
    """Checks that are repeated in all phases of a flight."""

    def __init__(self, vehicle: Vehicle, settings: FlightSettings, log: FlightLog) -> None:
        self._vehicle, self._settings, self._log = vehicle, settings, log
        self.asked_home = threading.Event()
        self.paused = threading.Event()
        self.starting = False
        """Whether it was commanded to arm and fly; it may fly even if the acknowledgement was lost."""
        self.airborne = False
        self.items: Sequence[MissionItem] = ()
        """Its mission."""
        self.deadline_s = math.inf
        """When the vehicle begins to return by itself, on the monotonic clock; infinite on its way."""
        self.lost = False
        """Whether the vehicle was silent for too long."""
        self._commanded: frozenset[Mode] = frozenset()
        self._returns_in: Mode | None = None
        self._held_s = math.inf
        """Since when its failsafe has held it, on the monotonic clock."""
        self._home = vehicle.home
        self._warned = ""
        self._way: list[Place] = []
        """The places of its mission, from where it began it."""

    def control(self, state: VehicleState) -> Control:
        """Who commands the vehicle. A return that is an item of a mission leaves ArduPilot in AUTO."""
        if not state.armed:
            return Control.LANDED
        if state.mode in (*_RETURNING, self._returns_in):
            return Control.RETURNING
        if state.mode is Mode.MISSION and self._has_waited(state):
            return Control.RETURNING
        if state.mode in self._commanded:
            return Control.OURS
        return Control.RETURNING if self._holds_first(state) else Control.OTHERS

    def _holds_first(self, state: VehicleState) -> bool:
        """Whether a failsafe of PX4's holds the vehicle before it returns or lands."""
        now = time.monotonic()
        if not (state.failsafe and state.mode is Mode.PAUSE):
            self._held_s = math.inf
            return False
        self._held_s = min(self._held_s, now)
        return now - self._held_s < self._vehicle.dialect.holds_s

    @contextmanager
    def commanding(self, mode: Mode) -> Iterator[None]:
        """Expect this mode from now on; until the command has succeeded, the mode before as well."""
        mode = self._vehicle.dialect.reported(mode)
        self._commanded |= {mode}
        yield
        self._commanded = frozenset({mode})

    def release(self, mode: Mode) -> None:
        """Command nothing any more: it returns in ``mode``, whatever its item.

        ArduPilot goes to item 0 when it has landed, before it says that it is disarmed. In a pause it only
        holds before it returns.
        """
        self._commanded, self._returns_in = frozenset(), None if mode is Mode.PAUSE else mode

    def flies(self, way: Sequence[Place] = ()) -> None:
        """The vehicle flies its mission, from where it is along ``way``."""
        state = self._vehicle.last_state
        self.airborne, self.deadline_s = True, math.inf
        self._way = [state.place, *way]

    def resumes(self) -> None:
        """The vehicle flies on after a pause, in which it may have been moved."""
        self._way = [self._vehicle.last_state.place, *self._way]

    def take_over(self) -> None:
        """Stop a vehicle that flies already, which the operator has allowed."""
        state = self.here()
        if state.armed and state.height_m > _IN_THE_AIR_M:
            with self.commanding(Mode.PAUSE):
                self._vehicle.pause()
            self.airborne = True

    def here(self) -> VehicleState:
        """The vehicle's state. Waits for one that is silent; raises ``NoAnswerError`` when it stays so."""
        try:
            state = self._vehicle.state
            self._show_warnings(state)
            return state
        except NoAnswerError as silence:
            if self.lost:
                raise
            lasts_s = self._settings.silence_s
            text = f"{silence.message} Waiting {lasts_s:.0f} s for it."
            self._log.event("silent", text, self._vehicle.last_state)
            until = time.monotonic() + lasts_s
            while time.monotonic() < until:
                time.sleep(POLL_S)
                try:
                    state = self._vehicle.state
                except NoAnswerError:
                    continue
                self._log.event("heard", "The vehicle is heard again.", state)
                self._vehicle.recover_captures()
                return state
            self.lost = True
            raise

    def require_going_on(self) -> VehicleState:
        """The vehicle's state; raises ``EndedError`` when it must return, does, or is not ours."""
        state = self.here()
        self._notice_home(state)
        if self.asked_home.is_set():
            raise EndedError(Ending.STOPPED, "it was asked to return home.")
        if not self.airborne and (still_s := self._vehicle.stood_still_s) > STOOD_STILL_S:
            raise EndedError(
                Ending.FAILED, f"this program stood still for {still_s:.0f} s before takeoff: begin again."
            )
        if not (self.airborne or self.starting):
            if state.armed and not self._settings.take_over:
                raise EndedError(
                    Ending.PILOT,
                    f"the vehicle is armed, in {state.mode_name}: somebody else flies it. It is left alone; "
                    "--take-over flies it.",
                )
            return state
        if not (self.airborne or state.armed):
            return state
        control = self.control(state)
        if control is not Control.OURS:
            raise EndedError(
                Ending.PILOT if control is Control.OTHERS else Ending.VEHICLE, self.why(control, state)
            )
        if state.replaced_by is not None:
            raise EndedError(
                Ending.PILOT,
                f"another ground station has replaced the mission: it has {state.replaced_by} items instead "
                f"of {len(self.items)}. The vehicle is left alone: command it.",
            )
        if state.mode is Mode.MISSION and len(self._way) > 1:
            away_m = off_m(state.place, self._way)
            if away_m > _OFF_M:
                raise EndedError(
                    Ending.VEHICLE,
                    f"the vehicle is {away_m:.0f} m off its way: too much wind, or a wrong position. "
                    "Land it if it does not return.",
                )
        if state.battery is not None and state.battery <= self._settings.reserve:
            raise EndedError(Ending.BATTERY, f"the battery is at {state.battery:.0%}.")
        if self.paused.is_set():
            self.deadline_s = max(self.deadline_s, time.monotonic() + self._settings.patience_s)
        return state

    def require_in_time(self) -> None:
        """Raise ``EndedError`` when the vehicle has waited for its next mission as long as it may."""
        if time.monotonic() > self.deadline_s:
            waited = f"the vehicle waited {self._settings.patience_s:.0f} s (--patience)"
            raise EndedError(Ending.SERVICE, f"the model was not updated in time: {waited}.")

    def why(self, control: Control, state: VehicleState) -> str:
        """Why a vehicle is not ours: its mode, and who may have commanded it."""
        texts = [text for text in self._vehicle.said(_FAILSAFE_S) if _FAILSAFE.search(text)]
        texts = [text for text in texts if not text.startswith(_NO_CAUSE)] or texts
        failsafe = f"its failsafe (it says: {texts[-1]})" if texts else ""
        if control is Control.LANDED:
            return "the vehicle has landed" + (f", by {failsafe}." if failsafe else ".")
        if control is Control.RETURNING and self._has_waited(state) and not failsafe:
            waited = f"it waited {self._settings.patience_s:.0f} s for its next view (--patience)"
            return f"the vehicle returns by itself: {waited}."
        who = failsafe or "a pilot or another ground station"
        if control is Control.RETURNING:
            return f"the vehicle is in {state.mode_name}, commanded by {who}."
        return f"{who} has taken over, in {state.mode_name}: the vehicle's mode is not changed any more."

    def wait_while_paused(self) -> None:
        """Wait for the end of a pause; raises ``EndedError`` when the vehicle must return, or does."""
        while self.paused.is_set():
            self.require_going_on()
            time.sleep(POLL_S)

    def trying(self, call: Callable[[], T]) -> T:
        """Call the service, repeatedly while it cannot be reached and the vehicle can wait.

        The vehicle is watched meanwhile, and an answer is not waited for when the flight ends.
        """
        reported = ""
        while True:
            try:
                return self._watched(call)
            except FvsError as error:
                if isinstance(error, VehicleError) or not error.retryable:
                    raise
                if isinstance(error, NoSnapshotError):
                    raise EndedError(Ending.SERVICE, f"{error.message} {error.hint}") from error
                if error.message != reported:
                    reported = error.message
                    self._log.event("service", f"{reported} Trying again.", self._vehicle.last_state)
                until = time.monotonic() + _RETRY_S
                while time.monotonic() < until:
                    self.require_going_on()
                    time.sleep(POLL_S)
                if time.monotonic() > self.deadline_s:
                    reason = f"the service is away: {error.message}"
                    raise EndedError(Ending.SERVICE, reason) from error

    def _watched(self, call: Callable[[], T]) -> T:
        """What ``call`` returns, in a thread of its own; raises what it raises, and ``EndedError``."""
        answer: Future[T] = Future()

        def run() -> None:
            try:
                answer.set_result(call())
            except BaseException as error:
                answer.set_exception(error)

        threading.Thread(target=run, name="service", daemon=True).start()
        while not wait([answer], POLL_S).done:
            self.require_going_on()
        return answer.result()

    def _has_waited(self, state: VehicleState) -> bool:
        """Whether no mission has come in time: it is at the return of its last."""
        if not self.items or state.item < 0:
            return False
        return state.item >= len(self.items) or self.items[state.item].command == Command.RETURN_TO_LAUNCH

    def _show_warnings(self, state: VehicleState) -> None:
        """Show what the autopilot warns of in flight; what it repeats, once."""
        for text in self._vehicle.warnings():
            if (self.airborne or self.starting) and text != self._warned and not text.startswith(_UPLOADS):
                self._log.event("warning", f"The vehicle says: {text}", state)
            self._warned = text

    def _notice_home(self, state: VehicleState) -> None:
        """Report a home that has moved: the vehicle returns there, and heights are measured from it."""
        home = self._vehicle.home
        moved_m = self._home.moved_m(home)
        if moved_m > _HOME_M:
            up_m = home.altitude_m - self._home.altitude_m
            text = f"Home has moved by {moved_m:.0f} m ({up_m:+.0f} m in height): the vehicle returns there."
            self._log.event("home", text, state, **vars(home))
            self._home = home
