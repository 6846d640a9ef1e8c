"""What a simulated autopilot tells of its vehicle, gimbal and camera: at intervals, or when it is asked to.

https://mavlink.io/en/messages/common.html, https://mavlink.io/en/services/camera.html,
https://mavlink.io/en/services/gimbal_v2.html
"""

import math
import shutil
from collections.abc import Callable

import numpy as np

from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.simulate.mavlink.dialect import mavlink
from fvs_engine.simulate.mavlink.flight_state import FlightState
from fvs_engine.simulate.vehicle import Vehicle
from fvs_engine.simulate.vehicle_camera import VehicleCamera

_FASTEST_S = 0.1
"""Messages are no more frequent, however fast simulated time is."""
_MIB = 2.0**20
_GIMBAL = 1
"""A gimbal that speaks no MAVLink has a number from 1 to 6."""
_GIMBAL_MOVES = mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_AXIS
_GIMBAL_FLAGS = (
    mavlink.GIMBAL_DEVICE_FLAGS_ROLL_LOCK
    | mavlink.GIMBAL_DEVICE_FLAGS_PITCH_LOCK
    | mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
)
_LIKE_VERSION = 4 << 24 | 5 << 16 | mavlink.FIRMWARE_VERSION_TYPE_OFFICIAL
"""ArduCopter 4.5, whose behaviour this is."""
_SENSOR_MM = 36.0
_UNKNOWN_16, _UNKNOWN_8 = 65_535, 255
_NO_TURN = (1.0, 0.0, 0.0, 0.0)


class Telemetry:
    """Sends messages by ``tell``. Simulated time, and what is told in it, is ``speed_up`` times as fast."""

    def __init__(
        self,
        vehicle: Vehicle,
        camera: VehicleCamera,
        origin: GeodeticPosition,
        state: FlightState,
        tell: Callable[..., None],
        speed_up: float,
    ) -> None:
        self._vehicle, self._camera, self._origin, self._state = vehicle, camera, origin, state
        self._tell, self._speed_up = tell, speed_up
        self._messages: dict[int, Callable[[], None]] = {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_GLOBAL_POSITION_INT: self._position,
            mavlink.MAVLINK_MSG_ID_ATTITUDE: self._attitude,
            mavlink.MAVLINK_MSG_ID_SYS_STATUS: self._status,
            mavlink.MAVLINK_MSG_ID_MISSION_CURRENT: self._current,
            mavlink.MAVLINK_MSG_ID_GIMBAL_DEVICE_ATTITUDE_STATUS: self._gimbal_attitude,
            mavlink.MAVLINK_MSG_ID_BATTERY_STATUS: self._battery,
            mavlink.MAVLINK_MSG_ID_GPS_RAW_INT: self._gps,
            mavlink.MAVLINK_MSG_ID_VFR_HUD: self._speeds,
            mavlink.MAVLINK_MSG_ID_HOME_POSITION: self._home,
            mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION: self._version,
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: self._camera_information,
            mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: self._camera_settings,
            mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION: self._storage,
            mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: self._capture_status,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION: self._gimbal_information,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS: self._gimbal_status,
        }
        often, seldom = list(self._messages)[1:6], list(self._messages)[6:9]
        self._defaults = {mavlink.MAVLINK_MSG_ID_HEARTBEAT: 1.0}
        self._defaults |= dict.fromkeys(often, 0.2) | dict.fromkeys(seldom, 1.0)
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
        """Send a message so often, 0: as by default, negative: not at all. False if there is none like it."""
        if message not in self._messages:
            return False
        interval_s = self._defaults.get(message, -1.0) if interval_us == 0 else interval_us * 1e-6
        if interval_s < 0:
            self._intervals_s.pop(message, None)
        else:
            self._intervals_s[message] = interval_s
            self._next.pop(message, None)
        return True

    def photograph(self, number: int, file: str | None) -> None:
        """Tell of a photograph; ``file`` None: it failed."""
        place, height_mm = self._place(), self._height_mm
        quaternion = _quaternion(self._vehicle.yaw_deg, self._vehicle.pitch_deg)
        outcome = (number, int(file is not None), (file or "").encode())
        self._tell("camera_image_captured_send", self._clock, 0, 0, *place, height_mm, quaternion, *outcome)

    def _heartbeat(self) -> None:
        armed = self._state.armed
        flags = mavlink.MAV_MODE_FLAG_CUSTOM_MODE_ENABLED | (
            mavlink.MAV_MODE_FLAG_SAFETY_ARMED if armed else 0
        )
        state = mavlink.MAV_STATE_ACTIVE if armed else mavlink.MAV_STATE_STANDBY
        kinds = (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA)
        self._tell("heartbeat_send", *kinds, flags, int(self._state.mode), state)

    def _position(self) -> None:
        east, north, up = self._vehicle.velocity
        speeds = (round(100.0 * north), round(100.0 * east), round(-100.0 * up))
        heading = round(self._vehicle.yaw_deg * 100.0) % 36_000
        self._tell("global_position_int_send", self._clock, *self._place(), self._height_mm, *speeds, heading)

    def _attitude(self) -> None:
        yaw = math.radians((self._vehicle.yaw_deg + 180.0) % 360.0 - 180.0)
        self._tell("attitude_send", self._clock, 0.0, 0.0, yaw, 0.0, 0.0, 0.0)

    def _status(self) -> None:
        self._tell("sys_status_send", 0, 0, 0, 0, _UNKNOWN_16, -1, self._battery_percent, 0, 0, 0, 0, 0, 0)

    def _current(self) -> None:
        self._tell("mission_current_send", self._state.item)

    def _gimbal_attitude(self) -> None:
        quaternion, unknown = _quaternion(0.0, self._vehicle.pitch_deg), (math.nan,) * 3
        self._tell(
            "gimbal_device_attitude_status_send",
            0,
            0,
            self._clock,
            _GIMBAL_FLAGS,
            quaternion,
            *unknown,
            0,
            gimbal_device_id=_GIMBAL,
        )

    def _battery(self) -> None:
        kinds = (mavlink.MAV_BATTERY_FUNCTION_ALL, mavlink.MAV_BATTERY_TYPE_LIPO)
        left_s = round(self._vehicle.battery * self._vehicle.endurance_s)
        unknown = (32_767, [_UNKNOWN_16] * 10, -1, -1, -1)
        self._tell("battery_status_send", 0, *kinds, *unknown, self._battery_percent, left_s)

    def _gps(self) -> None:
        noise_mm = round(self._vehicle.gps.noise_m * 1e3)
        unknown = (_UNKNOWN_16,) * 4
        fix = (mavlink.GPS_FIX_TYPE_3D_FIX, *self._place(), *unknown, _UNKNOWN_8)
        accuracy = {"h_acc": noise_mm, "v_acc": round(1.5 * noise_mm)}
        self._tell("gps_raw_int_send", self._clock * 1_000, *fix, **accuracy)

    def _speeds(self) -> None:
        velocity, altitude_m = self._vehicle.velocity, self._place()[2] * 1e-3
        speed = float(np.hypot(*velocity[:2]))
        heading = round(self._vehicle.yaw_deg) % 360
        self._tell("vfr_hud_send", speed, speed, heading, 0, altitude_m, float(velocity[2]))

    def _home(self) -> None:
        origin = self._origin
        place = (
            round(origin.latitude_deg * 1e7),
            round(origin.longitude_deg * 1e7),
            round(origin.altitude_m * 1e3),
        )
        self._tell("home_position_send", *place, 0.0, 0.0, 0.0, _NO_TURN, math.nan, math.nan, math.nan)

    def _version(self) -> None:
        able = (
            mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_PARAM_FLOAT
            | mavlink.MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        )
        none = [0] * 8
        self._tell("autopilot_version_send", able, _LIKE_VERSION, 0, 0, 0, none, none, none, 0, 0, 1)

    def _camera_information(self) -> None:
        lens = self._camera.scenery.camera
        names = (_padded("fvs"), _padded("simulated"))
        sensor = (
            _SENSOR_MM * lens.fx / lens.width,
            _SENSOR_MM,
            _SENSOR_MM * lens.height / lens.width,
            lens.width,
            lens.height,
            0,
        )
        more = (mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE, 0, b"", _GIMBAL)
        self._tell("camera_information_send", self._clock, *names, 1, *sensor, *more)

    def _camera_settings(self) -> None:
        self._tell("camera_settings_send", self._clock, mavlink.CAMERA_MODE_IMAGE)

    def _storage(self) -> None:
        total, used, free = (size / _MIB for size in shutil.disk_usage(self._camera.folder))
        status = (1, 1, mavlink.STORAGE_STATUS_READY)
        self._tell("storage_information_send", self._clock, *status, total, used, free, math.nan, math.nan)

    def _capture_status(self) -> None:
        free_mib = shutil.disk_usage(self._camera.folder).free / _MIB
        self._tell("camera_capture_status_send", self._clock, 0, 0, 0.0, 0, free_mib, self._state.photographs)

    def _gimbal_information(self) -> None:
        limits = self._vehicle.limits
        able = _GIMBAL_MOVES | mavlink.GIMBAL_MANAGER_CAP_FLAGS_HAS_PITCH_LOCK
        pitch = (math.radians(limits.gimbal_lowest_deg), math.radians(limits.gimbal_highest_deg))
        angles = (0.0, 0.0, *pitch, 0.0, 0.0)
        self._tell("gimbal_manager_information_send", self._clock, able, _GIMBAL, *angles)

    def _gimbal_status(self) -> None:
        self._tell("gimbal_manager_status_send", self._clock, _GIMBAL_FLAGS, _GIMBAL, 0, 0, 0, 0)

    @property
    def _clock(self) -> int:
        return self._state.clock_ms

    @property
    def _battery_percent(self) -> int:
        return round(self._vehicle.battery * 100.0)

    @property
    def _height_mm(self) -> int:
        return round(float(self._vehicle.believed[2]) * 1e3)

    def _place(self) -> tuple[int, int, int]:
        """Latitude, longitude and altitude of where it believes to be: degrees times 1e7, and mm."""
        here = geodetic_from_enu(self._vehicle.believed, self._origin)
        return round(here.latitude_deg * 1e7), round(here.longitude_deg * 1e7), round(here.altitude_m * 1e3)


def _quaternion(yaw_deg: float, pitch_deg: float) -> tuple[float, float, float, float]:
    """The attitude w, x, y, z of something level: north, east and down from forward, right and down."""
    yaw, pitch = 0.5 * math.radians(yaw_deg), 0.5 * math.radians(pitch_deg)
    return (
        math.cos(pitch) * math.cos(yaw),
        -math.sin(pitch) * math.sin(yaw),
        math.sin(pitch) * math.cos(yaw),
        math.cos(pitch) * math.sin(yaw),
    )


def _padded(name: str) -> list[int]:
    """A name as 32 bytes."""
    return list(name.encode().ljust(32, b"\0"))
