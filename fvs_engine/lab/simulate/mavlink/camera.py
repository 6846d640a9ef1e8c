"""The camera of a simulated vehicle as ground stations know it: https://mavlink.io/en/services/camera.html.

ArduPilot reports each photograph that it triggers by ``CAMERA_FEEDBACK``; PX4 by ``CAMERA_IMAGE_CAPTURED``,
as does a camera that speaks MAVLink, which is a component of its own.
"""

import math
import shutil
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any

from fvs_engine.choices import CameraReports
from fvs_engine.lab.simulate.mavlink import gimbal
from fvs_engine.lab.simulate.mavlink.attitude import level_quaternion
from fvs_engine.lab.simulate.mavlink.board import Board
from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.vehicle_camera import VehicleCamera

COMPONENT = int(mavlink.MAV_COMP_ID_CAMERA)
BEGAN_S = 1_767_268_800
"""2026-01-01 12:00 UTC, when simulated time begins."""
_MIB = 2.0**20
_SENSOR_MM = 36.0
_NO_TERRAIN_MM = -1_000
"""What PX4 reports as the height of a photograph above the ground, where it does not know that."""


class Camera:
    """Photographs with ``camera``; ``reports`` says which messages tell of it."""

    def __init__(self, board: Board, camera: VehicleCamera, reports: CameraReports) -> None:
        self._board, self._camera = board, camera
        self._told_by_autopilot = reports in ("both", "feedback")
        self.speaks = reports in ("both", "captured") and not board.faults.no_camera
        """Whether it is a component on the link."""
        self._taken: list[Callable[[], None]] = []
        self._busy_until_s = -math.inf
        kind = 0.0 if board.faults.no_camera else 6.0 if self.speaks else 1.0
        board.parameters.set("CAM1_TYPE", kind)
        if board.faults.no_camera:
            board.parameters.set("TRIG_MODE", 0.0)

    @property
    def autopilots_messages(self) -> Mapping[int, Callable[[], None]]:
        """What sends the messages that an autopilot with a camera sends of it."""
        if not self._board.firmware.is_ardupilot:
            return {}
        sends = {
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: partial(self._information, 1),
            mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: partial(self._settings, 1),
            mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: partial(self._status, 1),
        }
        return dict.fromkeys(sends, _nothing) if self._board.faults.no_camera else sends

    @property
    def messages(self) -> Mapping[int, Callable[[], None]]:
        """What sends the messages of a camera that speaks MAVLink."""
        return {
            mavlink.MAVLINK_MSG_ID_HEARTBEAT: self._heartbeat,
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION: partial(self._information, COMPONENT),
            mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS: partial(self._settings, COMPONENT),
            mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION: self._storage,
            mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS: partial(self._status, COMPONENT),
        }

    @property
    def has_trigger(self) -> bool:
        """Whether the autopilot has a camera trigger, which PX4 starts where ``TRIG_MODE`` is not 0."""
        return self._board.firmware.is_ardupilot or self._board.parameters.named("TRIG_MODE") != 0.0

    def trigger(self) -> bool:
        """Photograph by the autopilot; False without a camera, or so soon that a shutter is still pressed.

        PX4 knows neither. It has a camera trigger, or none.
        """
        if not self._board.firmware.is_ardupilot:
            if self.has_trigger and not self._board.faults.no_camera:
                self.photograph()
            return self.has_trigger
        now_s = self._board.state.time_s
        if self._board.faults.no_camera or now_s < self._busy_until_s:
            return False
        if not self.speaks:
            self._busy_until_s = now_s + self._board.parameters.named("CAM1_DURATION")
        self.photograph()
        return True

    def photograph(self) -> None:
        """Take a photograph, and report it."""
        number, state = len(self._taken), self._board.state
        file: str | None = None
        state.photographs += 1
        if number not in self._board.faults.failing_photographs:
            file = self._camera.take(self._board.vehicle, state.time_s).name
            self._board.say(f"photograph {file}")
        quaternion = level_quaternion(self._board.vehicle.yaw_deg, self._board.vehicle.pitch_deg)
        outcome = (number, int(file is not None), (file or "").encode())
        fields = (state.clock_ms, 0, 0, *self._board.place.encoded(), quaternion, *outcome)
        self._taken.append(partial(self._board.emit, "camera_image_captured", *fields, component=COMPONENT))
        if self._told_by_autopilot:
            self._feedback()
        if self.speaks:
            self._taken[-1]()

    def tell_again(self, number: int) -> bool:
        """Send the message of photograph ``number`` again; False if there is none."""
        if not 0 <= number < len(self._taken):
            return False
        self._taken[number]()
        return True

    def _feedback(self) -> None:
        state = self._board.state
        latitude, longitude, above_sea_mm, above_home_mm = self._board.place.encoded()
        if not self._board.firmware.is_ardupilot:
            quaternion = level_quaternion(self._board.vehicle.yaw_deg, 0.0)
            fields = (
                latitude,
                longitude,
                above_sea_mm,
                _NO_TERRAIN_MM,
                quaternion,
                state.photographs - 1,
                1,
                b"",
            )
            self._board.emit("camera_image_captured", state.clock_ms, 0, 1, *fields)
            return
        place = (latitude, longitude, above_sea_mm * 1e-3, above_home_mm * 1e-3)
        attitude = (0.0, 0.0, self._board.vehicle.yaw_deg)
        time_us = BEGAN_S * 1_000_000 + state.clock_ms * 1_000
        self._board.emit("camera_feedback", time_us, 0, 0, state.photographs, *place, *attitude, 0.0, 0)

    def _heartbeat(self) -> None:
        kinds = (mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID)
        self._board.emit("heartbeat", *kinds, 0, 0, mavlink.MAV_STATE_ACTIVE, component=COMPONENT)

    def _information(self, component: int) -> None:
        lens, state = self._camera.scenery.camera, self._board.state
        height_mm = _SENSOR_MM * lens.height / lens.width
        names: tuple[Any, ...] = (_padded("fvs"), _padded("simulated"), 1)
        sensor: tuple[Any, ...] = (_SENSOR_MM * lens.fx / lens.width, _SENSOR_MM, height_mm)
        size = (lens.width, lens.height)
        if not self.speaks:  # an autopilot knows nothing of a camera on a wire
            names, sensor, size = (_padded(""), _padded(""), 0), (math.nan,) * 3, (0, 0)
        apart = component != 1 and self._board.firmware.is_ardupilot
        number = 0 if self._board.faults.no_gimbal or apart else gimbal.NUMBER
        fields = (*names, *sensor, *size, 0, mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE, 0, b"", number)
        self._board.emit("camera_information", state.clock_ms, *fields, component=component)

    def _settings(self, component: int) -> None:
        fields = (self._board.state.clock_ms, mavlink.CAMERA_MODE_IMAGE)
        self._board.emit("camera_settings", *fields, component=component)

    def _storage(self) -> None:
        total, used, free = (size / _MIB for size in shutil.disk_usage(self._camera.folder))
        status = (1, 1, mavlink.STORAGE_STATUS_READY)
        fields = (*status, total, used, free, math.nan, math.nan)
        self._board.emit("storage_information", self._board.state.clock_ms, *fields, component=COMPONENT)

    def _status(self, component: int) -> None:
        free_mib = math.nan if component == 1 else shutil.disk_usage(self._camera.folder).free / _MIB
        fields = (0, 0, 0.0, 0, free_mib, self._board.state.photographs)
        self._board.emit("camera_capture_status", self._board.state.clock_ms, *fields, component=component)


def _nothing() -> None:
    """What ArduPilot sends of a camera that it does not have, when it accepts to send it."""


def _padded(name: str) -> list[int]:
    """A name as 32 bytes."""
    return list(name.encode().ljust(32, b"\0"))
