"""The messages in which a simulated autopilot tells of itself: https://mavlink.io/en/messages/common.html."""

import math
from collections.abc import Callable

import numpy as np

from fvs_engine.lab.simulate.mavlink.attitude import level_quaternion
from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.camera import BEGAN_S
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import CAPACITY_MAH
from fvs_engine.lab.simulate.mavlink.flight_state import Mode
from fvs_engine.lab.simulate.mavlink.receiver import Receiver, tell_home
from fvs_engine.lab.simulate.mavlink.sequencer import Sequencer

_UNKNOWN_16 = 65_535
_VOLTAGE_MV = 12_600
_PRESENT = 1_383_201_839
"""``MAV_SYS_STATUS_SENSOR`` of ArduCopter's simulator; the flags below are its, too."""
_ENABLED, _ENABLED_UNFIXED, _ENABLED_ARMED = 1_382_128_687, 1_380_031_535, 1_382_153_263
_HEALTHY, _HEALTHY_UNFIXED, _HEALTHY_ARMED = 1_450_286_127, 1_179_753_519, 1_450_310_703
_STEERED = frozenset(
    {Mode.MISSION, Mode.GUIDED, Mode.LOITER, Mode.RETURN, Mode.LAND, Mode.BRAKE, Mode.POSHOLD, Mode.CIRCLE}
)
"""Modes with a controller of positions."""
_ESTIMATES = 831
_NO_POSITION = (
    mavlink.EKF_ATTITUDE | mavlink.EKF_VELOCITY_VERT | mavlink.EKF_POS_VERT_ABS | mavlink.EKF_CONST_POS_MODE
)


class Reports:
    """Sends messages of the autopilot; ``sends`` has what sends each."""

    def __init__(self, board: Board, receiver: Receiver, mission: Sequencer) -> None:
        self._board, self._receiver, self._mission = board, receiver, mission
        self._last = (0, 0, 0, 0)
        """The last known position: zeros before the first fix."""
        self.sends: dict[int, Callable[[], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._position,
            mavlink.MAVLINK_MSG_ID_LOCAL_POSITION_NED: self._local_position,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION: self._attitude_quaternion,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._status,
            mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE: self._extended_state,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: lambda: self.current(self._mission.current),
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._speeds,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: lambda: tell_home(board),
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._version,
        }
        if board.firmware.is_ardupilot:
            self.sends |= {
                mavlink.MAVLINK_MSG_ID_EKF_STATUS_REPORT: self._estimates,
                mavlink.MAVLINK_MSG_ID_WIND: self._wind,
                mavlink.MAVLINK_MSG_ID_TIMESYNC: self._ask_time,
            }

    def current(self, number: int) -> None:
        """Send the number of the current item, which may be one that somebody has asked for."""
        first = int(self._board.firmware.home_is_first)
        total, in_mission = max(0, self._mission.count - first), int(self._board.state.mode is Mode.MISSION)
        if not total and not self._board.firmware.is_ardupilot:
            total = _UNKNOWN_16
        self._board.emit("mission_current", number, total, self._mission.state, in_mission)

    def time_answer(self, message: object) -> None:
        """Answer a ``TIMESYNC``."""
        if getattr(message, "tc1", 1) == 0:
            self._board.emit("timesync", self._clock * 1_000_000, getattr(message, "ts1", 0))

    def _heartbeat(self) -> None:
        state, firmware = self._board.state, self._board.firmware
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED
        if firmware.is_ardupilot:
            flags |= mavlink.MAV_MODE_FLAG_MANUAL_INPUT_ENABLED
            guided = state.mode is Mode.GUIDED or (state.armed and state.mode in _STEERED)
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED if guided else 0
        else:
            flags |= mavlink.MAV_MODE_FLAG_GUIDED_ENABLED | mavlink.MAV_MODE_FLAG_AUTO_ENABLED
        flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if state.armed else 0
        status = mavlink.MAV_STATE_ACTIVE if state.armed else mavlink.MAV_STATE_STANDBY
        if firmware.is_ardupilot and self._board.landed:
            status = mavlink.MAV_STATE_STANDBY
        if state.failsafe:
            status = mavlink.MAV_STATE_CRITICAL
        kinds = (mavlink.MAV_TYPE_QUADROTOR, firmware.autopilot)
        self._board.emit("heartbeat", *kinds, flags, firmware.custom_mode(state.mode), status)

    def _position(self) -> None:
        vehicle = self._board.vehicle
        if self._board.state.fixed:
            self._last = self._board.place.encoded()
        east, north, up = vehicle.velocity
        speeds = (round(100.0 * north), round(100.0 * east), round(-100.0 * up))
        heading = round(vehicle.yaw_deg * 100.0) % 36_000
        self._board.emit("global_position_int", self._clock, *self._last, *speeds, heading)

    def _local_position(self) -> None:
        if self._board.state.fixed:
            (east, north, up), (to_east, to_north, rise) = (
                self._board.vehicle.believed,
                self._board.vehicle.velocity,
            )
            fields = (north, east, -up, to_north, to_east, -rise)
            self._board.emit("local_position_ned", self._clock, *map(float, fields))

    def _attitude(self) -> None:
        yaw = math.radians((self._board.vehicle.yaw_deg + 180.0) % 360.0 - 180.0)
        self._board.emit("attitude", self._clock, 0.0, 0.0, yaw, 0.0, 0.0, 0.0)

    def _attitude_quaternion(self) -> None:
        quaternion = level_quaternion(self._board.vehicle.yaw_deg, 0.0)
        self._board.emit("attitude_quaternion", self._clock, *quaternion, 0.0, 0.0, 0.0)

    def _status(self) -> None:
        state = self._board.state
        flags = (_PRESENT, _ENABLED_UNFIXED, _HEALTHY_UNFIXED)
        if state.fixed:
            flags = (
                (_PRESENT, _ENABLED_ARMED, _HEALTHY_ARMED) if state.armed else (_PRESENT, _ENABLED, _HEALTHY)
            )
        self._board.emit("sys_status", *flags, 0, _VOLTAGE_MV, -1, self._battery_percent, 0, 0, 0, 0, 0, 0)

    def _extended_state(self) -> None:
        landed = mavlink.MAV_LANDED_STATE_ON_GROUND if self._board.landed else mavlink.MAV_LANDED_STATE_IN_AIR
        self._board.emit("extended_sys_state", mavlink.MAV_VTOL_STATE_UNDEFINED, landed)

    def _battery(self) -> None:
        vehicle = self._board.vehicle
        kinds = (mavlink.MAV_BATTERY_FUNCTION_ALL, mavlink.MAV_BATTERY_TYPE_LIPO)
        left_s = round(vehicle.battery * vehicle.endurance_s)
        used_mah = round((1.0 - vehicle.battery) * CAPACITY_MAH)
        voltages = [_VOLTAGE_MV, *[_UNKNOWN_16] * 9]
        fields = (32_767, voltages, -1, used_mah, -1)
        self._board.emit("battery_status", 0, *kinds, *fields, self._battery_percent, left_s)

    def _gps(self) -> None:
        noise_mm = round(self._board.vehicle.gps.noise_m * 1e3)
        none = mavlink.GPS_FIX_TYPE_NO_FIX
        fix: tuple[int, ...] = (none, 0, 0, 0, _UNKNOWN_16, _UNKNOWN_16, 0, 0, 0)
        if self._receiver.fixed:
            kind = (
                mavlink.GPS_FIX_TYPE_RTK_FIXED
                if self._board.firmware.is_ardupilot
                else mavlink.GPS_FIX_TYPE_3D_FIX
            )
            fix = (kind, *self._board.place.encoded()[:3], 121, 200, 0, 0, 10)
        accuracy = {"h_acc": noise_mm, "v_acc": round(1.5 * noise_mm)}
        self._board.emit("gps_raw_int", self._clock * 1_000, *fix, **accuracy)

    def _speeds(self) -> None:
        velocity, altitude_m = self._board.vehicle.velocity, self._board.place.encoded()[2] * 1e-3
        speed = float(np.hypot(*velocity[:2]))
        heading = round(self._board.vehicle.yaw_deg) % 360
        self._board.emit("vfr_hud", speed, speed, heading, 0, altitude_m, float(velocity[2]))

    def _system_time(self) -> None:
        self._board.emit("system_time", BEGAN_S * 1_000_000 + self._clock * 1_000, self._clock)

    def _estimates(self) -> None:
        flags = _ESTIMATES if self._board.state.fixed else _NO_POSITION
        self._board.emit("ekf_status_report", flags, 0.05, 0.05, 0.05, 0.05, 0.0)

    def _wind(self) -> None:
        east, north = self._board.vehicle.wind.mean_m_s
        coming_from_deg = math.degrees(math.atan2(-east, -north))
        self._board.emit("wind", coming_from_deg, math.hypot(east, north), 0.0)

    def _ask_time(self) -> None:
        self._board.emit("timesync", 0, self._clock * 1_000_000)

    def _version(self) -> None:
        able = (
            mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
            | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_FENCE
            | mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_RALLY
        )
        none = [0] * 8
        self._board.emit(
            "autopilot_version", able, self._board.firmware.version, 0, 0, 0, none, none, none, 0, 0, 1
        )

    @property
    def _clock(self) -> int:
        return self._board.state.clock_ms

    @property
    def _battery_percent(self) -> int:
        return round(self._board.vehicle.battery * 100.0)
