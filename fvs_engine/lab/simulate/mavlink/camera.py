"""The camera of a simulated vehicle as ground stations know it: https://mavlink.io/en/services/camera.html."""

import math
import shutil
from collections.abc import Callable, Mapping
from functools import partial

from fvs_engine.lab.simulate.mavlink import gimbal
from fvs_engine.lab.simulate.mavlink.attitude import level_quaternion
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.flight_state import Faults, FlightState
from fvs_engine.lab.simulate.vehicle import Vehicle
from fvs_engine.lab.simulate.vehicle_camera import VehicleCamera

_MIB = 2.0**20
_SENSOR_MM = 36.0


class Camera:
    """Photographs with ``camera``, and sends messages by ``emit``; ``place`` returns the estimated position.

    Each photograph's message can be requested again by its number, after a loss.
    """

    def __init__(
        self,
        vehicle: Vehicle,
        camera: VehicleCamera,
        state: FlightState,
        faults: Faults,
        place: Callable[[], tuple[int, int, int, int]],
        emit: Callable[..., None],
        say: Callable[[str], None],
    ) -> None:
        self._vehicle, self._camera, self._state, self._faults = vehicle, camera, state, faults
        self._place, self._emit, self._say = place, emit, say
        self._taken: list[Callable[[], None]] = []

    @property
    def messages(self) -> Mapping[int, Callable[[], None]]:
        """What sends each message."""
        return {
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: self._information,
            mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: self._settings,
            mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION: self._storage,
            mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: self._status,
        }

    def photograph(self) -> None:
        """Take a photograph, and send its message."""
        number = len(self._taken)
        file: str | None = None
        self._state.photographs += 1
        if number not in self._faults.failing_photographs:
            file = self._camera.take(self._vehicle, self._state.time_s).name
            self._say(f"photograph {file}")
        quaternion = level_quaternion(self._vehicle.yaw_deg, self._vehicle.pitch_deg)
        outcome = (number, int(file is not None), (file or "").encode())
        fields = (self._state.clock_ms, 0, 0, *self._place(), quaternion, *outcome)
        self._taken.append(partial(self._emit, "camera_image_captured_send", *fields))
        self._taken[-1]()

    def tell_again(self, number: int) -> bool:
        """Send the message of photograph ``number`` again; False if there is none."""
        if not 0 <= number < len(self._taken):
            return False
        self._taken[number]()
        return True

    def _information(self) -> None:
        lens = self._camera.scenery.camera
        names = (_padded("fvs"), _padded("simulated"))
        height_mm = _SENSOR_MM * lens.height / lens.width
        sensor = (_SENSOR_MM * lens.fx / lens.width, _SENSOR_MM, height_mm, lens.width, lens.height, 0)
        more = (mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE, 0, b"", gimbal.NUMBER)
        self._emit("camera_information_send", self._state.clock_ms, *names, 1, *sensor, *more)

    def _settings(self) -> None:
        self._emit("camera_settings_send", self._state.clock_ms, mavlink.CAMERA_MODE_IMAGE)

    def _storage(self) -> None:
        total, used, free = (size / _MIB for size in shutil.disk_usage(self._camera.folder))
        status = (1, 1, mavlink.STORAGE_STATUS_READY)
        fields = (*status, total, used, free, math.nan, math.nan)
        self._emit("storage_information_send", self._state.clock_ms, *fields)

    def _status(self) -> None:
        free_mib = shutil.disk_usage(self._camera.folder).free / _MIB
        fields = (0, 0, 0.0, 0, free_mib, self._state.photographs)
        self._emit("camera_capture_status_send", self._state.clock_ms, *fields)


def _padded(name: str) -> list[int]:
    """A name as 32 bytes."""
    return list(name.encode().ljust(32, b"\0"))
