"""The GPS receiver and the position estimate of a simulated autopilot; home."""

from fvs_engine.lab.simulate.mavlink.board import Board

_LOST_S = 1.0
"""How long an estimate lasts without a fix."""


class Receiver:
    """Has a fix ``after_s`` seconds after it was switched on, and sets home then."""

    def __init__(self, board: Board, after_s: float) -> None:
        self._board, self._after_s = board, after_s
        self._fixed_s = 0.0

    @property
    def fixed(self) -> bool:
        """Whether the receiver has a fix."""
        return self._board.state.time_s >= self._after_s and not self._board.faults.no_fix

    def update(self) -> None:
        """Find the position, or lose it."""
        state = self._board.state
        if self.fixed:
            self._fixed_s = state.time_s
            if not state.fixed and self._board.firmware.is_ardupilot:
                self._board.text("EKF3 IMU0 is using GPS")
            state.fixed = True
            if state.home is None:
                set_home(self._board)
        elif state.time_s - self._fixed_s > _LOST_S:
            state.fixed = False


def set_home(board: Board) -> None:
    """Make where it is home, and tell all."""
    board.state.home = board.vehicle.believed
    tell_home(board)


def tell_home(board: Board) -> None:
    """Send where home is, once it is known."""
    if board.state.home is None:
        return
    home, nan = board.place.home(), float("nan")
    place = (round(home.latitude_deg * 1e7), round(home.longitude_deg * 1e7), round(home.altitude_m * 1e3))
    time_us = board.state.clock_ms * 1_000
    east, north, up = board.state.home
    local = (float(north), float(east), -float(up))
    board.emit("home_position", *place, *local, (nan,) * 4, 0.0, 0.0, 0.0, time_us)
