"""The gimbal of a simulated vehicle as ground stations know it: https://mavlink.io/en/services/gimbal_v2.html."""

import math
from collections.abc import Callable, Mapping

from fvs_engine.lab.simulate.mavlink.attitude import level_quaternion
from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink

NUMBER = 1
"""A gimbal that speaks no MAVLink has a number from 1 to 6."""
_ABLE = (
    mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_NEUTRAL
    | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
    | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_LOCK
)
_FLAGS = (
    mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
    | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
    | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
)


class Gimbal:
    """Points the camera up and down."""

    def __init__(self, board: Board) -> None:
        self._board = board
        self._control = (0, 0)
        """The system and component in control."""
        limits = board.vehicle.limits
        middle_deg = 0.5 * (limits.gimbal_lowest_deg + limits.gimbal_highest_deg)
        self._default_deg = middle_deg if board.firmware.is_ardupilot else 0.0
        """ArduPilot's follows a knob of the remote control, which is in its middle."""
        self._pitch_deg = 0.0
        self.reset()
        board.vehicle.pitch_deg = self._pitch_deg

    @property
    def messages(self) -> Mapping[int, Callable[[], None]]:
        """What sends each message."""
        sends = {
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._attitude,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: self._information,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: self._status,
        }
        if not self._board.faults.no_gimbal:
            return sends
        return dict.fromkeys(sends, lambda: None) if self._board.firmware.is_ardupilot else {}

    def reset(self) -> None:
        """Point to where it points when nobody commands it."""
        if not self._board.faults.no_gimbal:
            self._pitch_deg = self._default_deg

    def point(self, pitch_deg: float) -> bool:
        """Point to a pitch; False without a gimbal or a number."""
        if self._board.faults.no_gimbal or not math.isfinite(pitch_deg):
            return False
        self._pitch_deg = pitch_deg
        return True

    def configure(self, system: int, component: int) -> bool:
        """Give somebody the control; False without a gimbal."""
        self._control = (system, component)
        return not self._board.faults.no_gimbal

    def advance(self, seconds: float) -> None:
        """Turn for ``seconds``."""
        self._board.vehicle.point(seconds, self._pitch_deg)

    def _attitude(self) -> None:
        state = self._board.state
        quaternion, unknown = level_quaternion(0.0, self._board.vehicle.pitch_deg), (math.nan,) * 3
        fields = (0, 0, state.clock_ms, _FLAGS, quaternion, *unknown, 0)
        self._board.emit("gimbal_device_attitude_status", *fields, gimbal_device_id=NUMBER)

    def _information(self) -> None:
        limits = self._board.vehicle.limits
        pitch = (math.radians(limits.gimbal_lowest_deg), math.radians(limits.gimbal_highest_deg))
        angles = (0.0, 0.0, *pitch, 0.0, 0.0)
        self._board.emit("gimbal_manager_information", self._board.state.clock_ms, _ABLE, NUMBER, *angles)

    def _status(self) -> None:
        fields = (self._board.state.clock_ms, _FLAGS, NUMBER, *self._control, 0, 0)
        self._board.emit("gimbal_manager_status", *fields)
