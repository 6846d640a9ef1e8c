"""What keeps the motors from being started: checks of ArduPilot's, in its words, and some of PX4's."""

from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.fence import Fence, fence_names
from fvs_engine.lab.simulate.mavlink.flight_state import Mode

_MAY_ARM_IN_AUTO = 1


class Arming:
    """Checks before arming."""

    def __init__(self, board: Board, fence: Fence) -> None:
        self._board, self._fence = board, fence

    def refusal(self) -> str | None:
        """Why it does not arm now; None when it does."""
        state, firmware = self._board.state, self._board.firmware
        if not firmware.is_ardupilot:
            if state.station_lost and self._board.parameters.named("NAV_DLL_ACT") > 0.0:
                return "Preflight Fail: No connection to the GCS"
            return None if state.fixed else "Arming denied! No valid position estimate"
        before = self.before_mode()
        if before is not None:
            return before
        kind, options = firmware.modes[state.mode], int(self._board.parameters.named("AUTO_OPTIONS"))
        if not kind.arms and not (state.mode is Mode.MISSION and options & _MAY_ARM_IN_AUTO):
            return f"Arm: {kind.name} mode not armable"
        return None

    def before_mode(self) -> str | None:
        """Why it does not arm in any mode, or in this one for want of a position."""
        state = self._board.state
        if not state.fixed:
            if self._board.firmware.modes[state.mode].needs_position:
                return "PreArm: Need Position Estimate"
            if self._fence.enabled:
                return "PreArm: Fence requires position"
        if self._fence.breaches():
            return f"PreArm: Vehicle breaching {fence_names(self._fence.breaches())}"
        if state.failsafe:
            return "PreArm: Failsafe on"
        return None
