"""What a simulated ArduCopter does by itself: low battery, lost ground station, fence, lost position.

https://ardupilot.org/copter/docs/failsafe-landing-page.html; texts are ArduPilot's.
"""

import time
from typing import Any

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.fence import Fence, fence_names
from fvs_engine.lab.simulate.mavlink.firmware import CAPACITY_MAH, Meaning
from fvs_engine.lab.simulate.mavlink.flight_state import Mode
from fvs_engine.lab.simulate.mavlink.pilot import Pilot

_LAND, _RETURNS = 1, frozenset({2, 3, 6})
"""Actions of ``BATT_FS_LOW_ACT`` and ``BATT_FS_CRT_ACT``; what is no return here, and not 0, lands."""
_LINK_LANDS, _LINK_RETURNS = frozenset({4, 5, 7}), frozenset({1, 2, 3, 6})
"""Values of ``FS_GCS_ENABLE``."""
_GO_ON_IN_AUTO, _GO_ON_LANDING, _GO_ON_WITH_PILOT = 2, 8, 16
"""Bits of ``FS_OPTIONS``."""
_AUTOPILOTS = frozenset({Mode.MISSION, Mode.GUIDED, Mode.RETURN, Mode.LAND, Mode.CIRCLE})
"""The others, BRAKE as well, count as flown by a pilot."""
_FAR_OUTSIDE_M = 100.0
_WARNING, _CRITICAL, _NOTICE, _INFO = (
    int(mavlink.MAV_SEVERITY_WARNING),
    int(mavlink.MAV_SEVERITY_CRITICAL),
    int(mavlink.MAV_SEVERITY_NOTICE),
    int(mavlink.MAV_SEVERITY_INFO),
)


class Failsafes:
    """Acts for the ``pilot``. Ground stations are missed in real time, since they know no other."""

    def __init__(self, board: Board, pilot: Pilot, fence: Fence) -> None:
        self._board, self._pilot, self._fence = board, pilot, fence
        self._batteries: set[Meaning] = set()
        """The levels of the battery that have been acted on."""
        self._station_s: float | None = None
        self._station_lost = False
        self._breached = False
        self._position_lost = False

    def heard(self, heartbeat: Any) -> None:
        """Note the heartbeat of a system: only one of them is the ground station."""
        if heartbeat.get_srcSystem() == round(self._board.parameters.named("SYSID_MYGCS")):
            self._station_s = time.monotonic()

    def check(self) -> None:
        """Act where that is needed."""
        self._check_battery()
        self._check_station()
        self._check_fence()
        self._check_position()
        self._board.state.failsafe = self._station_lost or bool(self._batteries) or self._position_lost

    def _check_battery(self) -> None:
        battery, parameters = self._board.vehicle.battery, self._board.parameters
        for meaning, word, name in (
            (Meaning.EMPTY_BATTERY, "critical", "BATT_FS_CRT_ACT"),
            (Meaning.LOW_BATTERY, "low", "BATT_FS_LOW_ACT"),
        ):
            if battery > parameters.of(meaning) or meaning in self._batteries or not self._board.state.armed:
                continue
            self._batteries |= {meaning, Meaning.LOW_BATTERY}
            used_mah = (1.0 - battery) * CAPACITY_MAH
            self._board.text(f"Battery 1 is {word} 12.60V used {used_mah:.0f} mAh", _WARNING)
            action = round(parameters.named(name))
            self._act("Battery", None if action == 0 else Mode.RETURN if action in _RETURNS else Mode.LAND)
            return

    def _check_station(self) -> None:
        parameters, state = self._board.parameters, self._board.state
        enabled = round(parameters.named("FS_GCS_ENABLE"))
        if not enabled or self._station_s is None:
            self._station_lost = False
            return
        lost = time.monotonic() - self._station_s > parameters.named("FS_GCS_TIMEOUT")
        if lost == self._station_lost:
            return
        self._station_lost = lost
        options = int(parameters.named("FS_OPTIONS"))
        if not lost:
            self._board.text("GCS Failsafe Cleared", _WARNING)
        elif not state.armed:
            self._board.text("GCS Failsafe", _WARNING)
        elif state.mode is Mode.MISSION and options & _GO_ON_IN_AUTO:
            self._board.text("GCS Failsafe - Continuing Auto Mode", _WARNING)
        elif state.mode not in _AUTOPILOTS and options & _GO_ON_WITH_PILOT:
            self._board.text("GCS Failsafe - Continuing Pilot Control", _WARNING)
        else:
            self._act("GCS", Mode.LAND if enabled in _LINK_LANDS else Mode.RETURN)

    def _check_fence(self) -> None:
        if not self._board.state.armed:
            self._breached = False
            return
        breaches = {} if self._pilot.navigator.landing or self._board.landed else self._fence.breaches()
        if bool(breaches) == self._breached:
            return
        self._breached = bool(breaches)
        if not breaches:
            self._board.text("Fence breach cleared", _NOTICE)
            return
        self._board.text(f"{fence_names(breaches)} breached", _NOTICE)
        action = round(self._board.parameters.named("FENCE_ACTION"))
        if action == 0:
            return
        lands = action == 2 or max(breaches.values()) > _FAR_OUTSIDE_M
        mode = Mode.LAND if lands else Mode.BRAKE if action == 4 else Mode.RETURN
        if self._pilot.enter(mode, "fence"):
            self._board.text("Manual recovery started", _INFO)

    def _check_position(self) -> None:
        state = self._board.state
        lost = state.armed and not state.fixed and state.home is not None
        if lost == self._position_lost:
            return
        self._position_lost = lost
        if not lost:
            self._board.text("EKF Failsafe Cleared", _CRITICAL)
            return
        self._board.text("EKF variance", _CRITICAL)
        if self._board.firmware.modes[state.mode].needs_position:
            self._pilot.enter(Mode.LAND, "EKF")
            self._board.text("EKF Failsafe: changed to LAND Mode", _CRITICAL)

    def _act(self, kind: str, mode: Mode | None) -> None:
        """Announce a failsafe, and change to ``mode``; on the ground the motors stop."""
        options = int(self._board.parameters.named("FS_OPTIONS"))
        if self._board.landed:
            self._board.text(f"{kind} Failsafe - Disarming", _WARNING)
            self._pilot.disarm()
        elif self._pilot.navigator.landing and options & _GO_ON_LANDING and mode is not None:
            self._board.text(f"{kind} Failsafe - Continuing Landing", _WARNING)
            self._pilot.enter(Mode.LAND, f"{kind} failsafe")
        else:
            self._board.text(f"{kind} Failsafe", _WARNING)
            if mode is not None and not self._pilot.enter(mode, f"{kind} failsafe"):
                self._pilot.enter(Mode.LAND, f"{kind} failsafe")
