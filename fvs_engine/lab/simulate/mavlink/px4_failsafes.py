"""What a simulated PX4 does by itself: low battery, lost ground station, a mission that it cannot fly.

``failsafe.cpp``, ``framework.cpp`` and ``commander_params.yaml`` of its ``commander``. Before it returns or
lands it holds, in AUTO.LOITER, for ``COM_FAIL_ACT_T``. Its fence does not act.
"""

import time
from collections.abc import Iterator
from typing import Any

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import Meaning
from fvs_engine.lab.simulate.mavlink.flight_state import Mode
from fvs_engine.lab.simulate.mavlink.pilot import Pilot

_LINK_ACTIONS = {1: Mode.LOITER, 2: Mode.RETURN, 3: Mode.LAND}
_LOW_ACTIONS = {1: Mode.RETURN, 2: Mode.LAND, 3: Mode.RETURN}
_EMPTY_ACTIONS = {1: Mode.RETURN, 2: Mode.LAND, 3: Mode.LAND}
_MISSION = "mission"
_CRITICAL = int(mavlink.MAV_SEVERITY_CRITICAL)


class Px4Failsafes:
    """Acts for the ``pilot``. Ground stations are missed in real time, since they know no other."""

    def __init__(self, board: Board, pilot: Pilot) -> None:
        self._board, self._pilot = board, pilot
        self._station_s: float | None = None
        self._causes: set[str] = set()
        """What has been acted on."""
        self._mode: Mode | None = None
        """The mode that it has commanded."""
        self._next: tuple[float, Mode] | None = None
        """When it changes from holding, and to which mode."""

    def heard(self, heartbeat: Any) -> None:
        """Note the heartbeat of a ground station, whichever it is."""
        if heartbeat.type == mavlink.MAV_TYPE_GCS:
            self._station_s = time.monotonic()

    def check(self) -> None:
        """Act where that is needed. Who changes the mode then has taken over."""
        state = self._board.state
        lost = self._board.parameters.named("COM_DL_LOSS_T")
        state.station_lost = self._station_s is None or time.monotonic() - self._station_s > lost
        causes = dict(self._wanted()) if state.armed else {}
        self._causes &= causes.keys()
        for cause in [each for each in causes if each not in self._causes]:
            self._causes.add(cause)
            if cause == _MISSION:
                self._board.text("No valid mission available, loitering", _CRITICAL)
            self._act(causes[cause], holds=cause != _MISSION)
        if self._mode is not None and (state.mode is not self._mode or not state.armed):
            self._mode = self._next = None
        if self._next is not None and state.time_s >= self._next[0]:
            self._act(self._next[1], holds=False)
        state.failsafe = self._mode is not None

    def _wanted(self) -> Iterator[tuple[str, Mode]]:
        """The causes of now, and the mode that each calls for, the worst first."""
        named, battery = self._board.parameters.named, self._board.vehicle.battery
        action = round(named("COM_LOW_BAT_ACT"))
        if action in _EMPTY_ACTIONS and battery <= self._board.parameters.of(Meaning.EMPTY_BATTERY):
            yield "empty battery", _EMPTY_ACTIONS[action]
        elif action in _LOW_ACTIONS and battery <= self._board.parameters.of(Meaning.LOW_BATTERY):
            yield "low battery", _LOW_ACTIONS[action]
        action = round(named("NAV_DLL_ACT"))
        if self._board.state.station_lost and action in _LINK_ACTIONS:
            yield "station", _LINK_ACTIONS[action]
        if self._board.state.mode is Mode.MISSION and self._pilot.objection() is not None:
            yield _MISSION, Mode.RETURN

    def _act(self, mode: Mode, *, holds: bool) -> None:
        if self._board.state.mode in (mode, Mode.LAND):
            return
        seconds = self._board.parameters.named("COM_FAIL_ACT_T")
        self._next = None
        text = "Failsafe activated"
        if holds and seconds > 0.0 and self._mode is None and mode is not Mode.LOITER:
            self._next, mode = (self._board.state.time_s + seconds, mode), Mode.LOITER
            text += f", entering Hold for {seconds:.0f} seconds"
        self._board.text(text, _CRITICAL)
        self._mode = mode
        self._pilot.enter(mode, "failsafe")
