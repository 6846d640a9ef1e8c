"""Telemetry of a simulated autopilot and its vehicle, at intervals or on request.

https://mavlink.io/en/messages/common.html
"""

import math
from collections.abc import Callable, Mapping

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.firmware import CAPACITY_MAH, Firmware
from fvs_engine.lab.simulate.mavlink.flight_state import FlightState, Mode
from fvs_engine.lab.simulate.vehicle import Vehicle

_FASTEST_S = 0.1
"""Messages are no more frequent, however fast simulated time is."""
_UNKNOWN_16, _UNKNOWN_8 = 65_535, 255
_NO_TURN = (1.0, 0.0, 0.0, 0.0)
_BEGAN_S = 1_767_268_800
"""2026-01-01 12:00 UTC, when simulated time begins."""
_OFTEN_S, _SELDOM_S = 0.2, 1.0


class Telemetry:
    """Sends messages by ``emit``. Simulated time and its messages are ``speed_up`` times as fast.

    ``others`` are messages of the camera and the gimbal.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        origin: GeodeticPosition,
        state: FlightState,
        firmware: Firmware,
        emit: Callable[..., None],
        speed_up: float,
        others: Mapping[int, Callable[[], None]],
    ) -> None:
        self._vehicle, self._origin, self._state, self._firmware = vehicle, origin, state, firmware
        self._emit, self._speed_up = emit, speed_up
        often: dict[int, Callable[[], None]] = {
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._position,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._status,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: self._current,
        }
        seldom: dict[int, Callable[[], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._speeds,
            mavlink.MAVLINK_MSG_ID_SYSTEM_TIME: self._system_time,
        }
        asked: dict[int, Callable[[], None]] = {
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._version,
        }
        self._messages = {**often, **seldom, **asked, **others}
        self._defaults = dict.fromkeys(often, _OFTEN_S) | dict.fromkeys(seldom, _SELDOM_S)
        if mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS in others:
            self._defaults[mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS] = _OFTEN_S
        self._intervals_s = dict(self._defaults)
        self._next: dict[int, float] = {}

    def send(self, now: float) -> None:
        """Send what is due at ``now``, in real seconds."""
        for message, interval_s in self._intervals_s.items():
            if now >= self._next.get(message, now):
                self._next[message] = now + max(interval_s / self._speed_up, _FASTEST_S)
                self._messages[message]()

    def answer(self, message: int) -> bool:
        """Send a message once; False if there is none of this number."""
        send = self._messages.get(message)
        if send is not None:
            send()
        return send is not None

    def set_interval(self, message: int, interval_us: float) -> bool:
        """Set a message's interval; 0: the default, negative: never. False if there is no such message."""
        if message not in self._messages:
            return False
        interval_s = self._defaults.get(message, -1.0) if interval_us == 0 else interval_us * 1e-6
        if interval_s < 0:
            self._intervals_s.pop(message, None)
        else:
            self._intervals_s[message] = interval_s
            self._next.pop(message, None)
        return True

    def place(self) -> tuple[int, int, int, int]:
        """The estimated position: degrees times 1e7, mm above sea level, mm above home."""
        believed = self._vehicle.believed
        here = geodetic_from_enu(believed, self._origin)
        above_sea_mm, above_home_mm = round(here.altitude_m * 1e3), round(float(believed[2]) * 1e3)
        return round(here.latitude_deg * 1e7), round(here.longitude_deg * 1e7), above_sea_mm, above_home_mm

    def _heartbeat(self) -> None:
        armed = self._state.armed
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED
        flags |= mavlink.MAV_MODE_FLAG_STABILIZE_ENABLED | mavlink.MAV_MODE_FLAG_GUIDED_ENABLED
        flags |= mavlink.MAV_MODE_FLAG_AUTO_ENABLED if self._state.mode is Mode.MISSION else 0
        flags |= mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        state = mavlink.MAV_STATE_ACTIVE if armed else mavlink.MAV_STATE_STANDBY
        kinds = (mavlink.MAV_TYPE_QUADROTOR, self._firmware.autopilot)
        custom_mode = self._firmware.custom_mode(self._state.mode)
        self._emit("heartbeat_send", *kinds, flags, custom_mode, state)

    def _position(self) -> None:
        east, north, up = self._vehicle.velocity
        speeds = (round(100.0 * north), round(100.0 * east), round(-100.0 * up))
        heading = round(self._vehicle.yaw_deg * 100.0) % 36_000
        self._emit("global_position_int_send", self._clock, *self.place(), *speeds, heading)

    def _attitude(self) -> None:
        yaw = math.radians((self._vehicle.yaw_deg + 180.0) % 360.0 - 180.0)
        self._emit("attitude_send", self._clock, 0.0, 0.0, yaw, 0.0, 0.0, 0.0)

    def _status(self) -> None:
        self._emit("sys_status_send", 0, 0, 0, 0, _UNKNOWN_16, -1, self._battery_percent, 0, 0, 0, 0, 0, 0)

    def _current(self) -> None:
        self._emit("mission_current_send", self._state.item)

    def _battery(self) -> None:
        kinds = (mavlink.MAV_BATTERY_FUNCTION_ALL, mavlink.MAV_BATTERY_TYPE_LIPO)
        left_s = round(self._vehicle.battery * self._vehicle.endurance_s)
        used_mah = round((1.0 - self._vehicle.battery) * CAPACITY_MAH)
        fields = (32_767, [_UNKNOWN_16] * 10, -1, used_mah, -1)
        self._emit("battery_status_send", 0, *kinds, *fields, self._battery_percent, left_s)

    def _gps(self) -> None:
        noise_mm = round(self._vehicle.gps.noise_m * 1e3)
        unknown = (_UNKNOWN_16,) * 4
        fix = (mavlink.GPS_FIX_TYPE_3D_FIX, *self.place()[:3], *unknown, _UNKNOWN_8)
        accuracy = {"h_acc": noise_mm, "v_acc": round(1.5 * noise_mm)}
        self._emit("gps_raw_int_send", self._clock * 1_000, *fix, **accuracy)

    def _speeds(self) -> None:
        velocity, altitude_m = self._vehicle.velocity, self.place()[2] * 1e-3
        speed = float(np.hypot(*velocity[:2]))
        heading = round(self._vehicle.yaw_deg) % 360
        self._emit("vfr_hud_send", speed, speed, heading, 0, altitude_m, float(velocity[2]))

    def _system_time(self) -> None:
        self._emit("system_time_send", _BEGAN_S * 1_000_000 + self._clock * 1_000, self._clock)

    def _home(self) -> None:
        origin = self._origin
        place = (
            round(origin.latitude_deg * 1e7),
            round(origin.longitude_deg * 1e7),
            round(origin.altitude_m * 1e3),
        )
        self._emit("home_position_send", *place, 0.0, 0.0, 0.0, _NO_TURN, math.nan, math.nan, math.nan)

    def _version(self) -> None:
        able = (
            mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
            | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        )
        none = [0] * 8
        self._emit("autopilot_version_send", able, self._firmware.version, 0, 0, 0, none, none, none, 0, 0, 1)

    @property
    def _clock(self) -> int:
        return self._state.clock_ms

    @property
    def _battery_percent(self) -> int:
        return round(self._vehicle.battery * 100.0)
