"""The end of a flight: sends the vehicle home, and waits until it has landed."""

import time

from fvs_client.fly.dialects import Mode
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.log import FlightLog
from fvs_client.fly.settings import EndedError, Ending, FlightSettings
from fvs_client.fly.vehicle import Vehicle
from fvs_client.fly.watch import POLL_S, Control, Watch

_AGAIN_S = 1.0
_LAND_EVERY = 6
"""One in this many attempts to send the vehicle home commands it to land where it is."""


class Homecoming:
    """Sends a vehicle home; sends no command once somebody else has taken over."""

    def __init__(self, vehicle: Vehicle, watch: Watch, settings: FlightSettings, log: FlightLog) -> None:
        self._vehicle, self._watch, self._settings, self._log = vehicle, watch, settings, log
        self._refusals = 0
        self._reported = ""

    def wait(self) -> None:
        """Send it home and wait until it has landed, also where it is silent for a while.

        Raises ``EndedError`` when the landing was not seen, or somebody else flies it.
        """
        if not (self._watch.airborne or self._watch.starting):
            return
        until_s = time.monotonic() + self._settings.leg_s
        while True:
            try:
                state = self._watch.here()
                match control := self._watch.control(state):
                    case Control.LANDED:
                        if self._watch.airborne:
                            self._log.event("landed", "The vehicle has landed.", state)
                        return
                    case Control.OTHERS:
                        raise EndedError(Ending.PILOT, f"Now {self._watch.why(control, state)}")
                    case Control.OURS:
                        self._command()
                        until_s = time.monotonic() + self._settings.leg_s
                    case Control.RETURNING:
                        self._watch.release(state.mode)  # whoever changes its mode from now on
                self._watch.paused.clear()
                if time.monotonic() > until_s:
                    raise self._lost(f"it is in the air after {self._settings.leg_s:.0f} s.")
            except NoAnswerError as error:
                if self._watch.lost:
                    raise self._lost(f"{error.message} {error.hint}") from error
            except VehicleError as error:
                self._refused(error)
            time.sleep(POLL_S)

    def _command(self) -> None:
        """Return home; land in place if the vehicle keeps refusing that."""
        land = self._refusals % _LAND_EVERY == _LAND_EVERY - 1
        if land:
            self._log.event(
                "lands", "It does not return: it is to land where it is.", self._vehicle.last_state
            )
        mode = Mode.LAND if land else Mode.RETURN
        with self._watch.commanding(mode):
            self._vehicle.set_mode(mode)

    def _refused(self, error: VehicleError) -> None:
        self._refusals += 1
        if error.message != self._reported:
            self._reported = error.message
            self._log.event("refused", f"{self._reported} Trying again.", self._vehicle.last_state)
        time.sleep(_AGAIN_S)

    def _lost(self, text: str) -> EndedError:
        if self._watch.paused.is_set():
            text += (
                " It was paused: it stays where it is unless its failsafe for lost ground stations, or a "
                "pilot, acts."
            )
        text = f"Its landing was not seen: {text}"
        self._log.event("lost", text, self._vehicle.last_state)
        return EndedError(Ending.VEHICLE, text)
