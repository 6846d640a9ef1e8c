"""Supervision of a flight: whether the vehicle may continue, is silent, or must return."""

import math
import threading
import time
from collections.abc import Callable
from typing import TypeVar

from fvs_client import FvsError, NoSnapshotError
from fvs_client.fly.dialects import Mode
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.log import FlightLog
from fvs_client.fly.settings import EndedError, Ending, FlightSettings
from fvs_client.fly.vehicle import Vehicle, VehicleState

T = TypeVar("T")

POLL_S = 0.1
_RETRY_S = 2.0
RETURNING = (Mode.RETURN, Mode.LAND)
_OURS = (Mode.HOLD, Mode.PAUSE)
"""Modes that a flight changes to between missions, and for a pause."""


class Watch:
    """Checks that are repeated in all phases of a flight."""

    def __init__(self, vehicle: Vehicle, settings: FlightSettings, log: FlightLog) -> None:
        self._vehicle, self._settings, self._log = vehicle, settings, log
        self.asked_home = threading.Event()
        self.paused = threading.Event()
        self.starting = False
        """Whether it was commanded to arm and fly; it may fly even if the acknowledgement was lost."""
        self.airborne = False
        self.handing_over = False
        """Whether the vehicle gets its next mission now: it holds, and has none that ends at home."""
        self.deadline_s = math.inf
        """When the vehicle begins to return by itself, on the monotonic clock; infinite on its way."""
        self.lost = False
        """Whether the vehicle was silent for too long."""

    def here(self) -> VehicleState:
        """The vehicle's state. Waits for one that is silent; raises ``NoAnswerError`` when it stays so."""
        try:
            return self._vehicle.state
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
        """The vehicle's state; raises ``EndedError`` when it must return, or does."""
        paused = self.paused.is_set()
        state = self.here()
        paused |= self.paused.is_set()  # it may have been paused while it was silent
        if self.asked_home.is_set():
            raise EndedError(Ending.STOPPED, "it was asked to return home.")
        if not self.airborne:
            return state
        if state.battery is not None and state.battery <= self._settings.reserve:
            raise EndedError(Ending.BATTERY, f"the battery is at {state.battery:.0%}.")
        if state.mode in RETURNING:
            text = f"the vehicle returns by itself{self._last_message()}"
            if math.isfinite(self.deadline_s):
                text += f": it waited {self._settings.patience_s:.0f} s for its next view (--patience)"
            raise EndedError(Ending.VEHICLE, f"{text}.")
        if not state.armed:
            raise EndedError(Ending.VEHICLE, f"the vehicle has landed{self._last_message()}.")
        if not (state.mode is Mode.MISSION or (state.mode in _OURS and (paused or self.handing_over))):
            raise EndedError(
                Ending.PILOT,
                f"a pilot or another ground station has taken over{self._last_message()}: "
                "the vehicle's mode is not changed any more.",
            )
        if paused:
            self.deadline_s = max(self.deadline_s, time.monotonic() + self._settings.patience_s)
        return state

    def wait_while_paused(self) -> None:
        """Wait for the end of a pause; raises ``EndedError`` when the vehicle must return, or does."""
        while self.paused.is_set():
            self.require_going_on()
            time.sleep(POLL_S)

    def trying(self, call: Callable[[], T]) -> T:
        """Call the service, repeatedly while it cannot be reached and the vehicle can wait."""
        reported = ""
        while True:
            try:
                return call()
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

    def _last_message(self) -> str:
        return f" (it says: {texts[-1]})" if (texts := self._vehicle.texts) else ""
