"""The gimbal of a simulated vehicle as ground stations know it: https://mavlink.io/en/services/gimbal_v2.html."""

import math
from collections.abc import Callable, Mapping

from fvs_engine.lab.simulate.mavlink.attitude import level_quaternion
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import FlightState
from fvs_engine.lab.simulate.vehicle import Vehicle

NUMBER = 1
"""A gimbal that speaks no MAVLink has a number from 1 to 6."""
_ABLE = mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_LOCK
_FLAGS = (
    mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
    | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
    | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
)


class Gimbal:
    """Sends messages by ``emit``."""

    def __init__(self, vehicle: Vehicle, state: FlightState, emit: Callable[..., None]) -> None:
        self._vehicle, self._state, self._emit = vehicle, state, emit

    @property
    def messages(self) -> Mapping[int, Callable[[], None]]:
        """What sends each message."""
        return {
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._attitude,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: self._information,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: self._status,
        }

    def _attitude(self) -> None:
        quaternion, unknown = level_quaternion(0.0, self._vehicle.pitch_deg), (math.nan,) * 3
        fields = (0, 0, self._state.clock_ms, _FLAGS, quaternion, *unknown, 0)
        self._emit("gimbal_device_attitude_status_send", *fields, gimbal_device_id=NUMBER)

    def _information(self) -> None:
        limits = self._vehicle.limits
        pitch = (math.radians(limits.gimbal_lowest_deg), math.radians(limits.gimbal_highest_deg))
        angles = (0.0, 0.0, *pitch, 0.0, 0.0)
        self._emit("gimbal_manager_information_send", self._state.clock_ms, _ABLE, NUMBER, *angles)

    def _status(self) -> None:
        self._emit("gimbal_manager_status_send", self._state.clock_ms, _FLAGS, NUMBER, 0, 0, 0, 0)
