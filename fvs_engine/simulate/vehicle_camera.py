"""The camera of a simulated vehicle: photographs with motion blur, GPS in their EXIF, and a sidecar."""

import json
from dataclasses import dataclass, field
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from PIL import Image

from fvs_engine.files.atomic import replacing
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at, geodetic_from_enu
from fvs_engine.simulate.camera import SimulatedCamera
from fvs_engine.simulate.tracing import PackedWorld
from fvs_engine.simulate.vehicle import Vehicle
from fvs_engine.simulate.world import World

_JPEG_QUALITY = 92
_EXPOSURES = 3
"""Photographs that are averaged for the blur of one."""
_BLURRED_M = 0.005
"""Way in the exposure time from which a photograph is blurred."""
_BEGAN = datetime(2026, 1, 1, 12, tzinfo=UTC)
_GPS_IFD, _EXIF_IFD, _FOCAL_LENGTH_35MM, _TAKEN_AT = 0x8825, 0x8769, 0xA405, 0x9003


@dataclass
class VehicleCamera:
    """Photographs a made-up ``world`` into ``folder``, as ``scale`` times as large as it was made.

    The world's axes are ENU at ``origin``. Files are named in order. EXIF and the sidecar, ``NAME.jpg.json``,
    have the receiver's fix, yaw and pitch. ``exposure_s`` blurs what moves.
    """

    folder: Path
    world: World
    origin: GeodeticPosition
    camera: SimulatedCamera = field(default_factory=SimulatedCamera.like_a_drone)
    scale: float = 1.0
    exposure_s: float = 0.004
    seed: int = 0

    def __post_init__(self) -> None:
        self._packed = PackedWorld(self.world)
        self.camera.photograph(self._packed, camera_at(np.ones(3), 0.0, 0.0), 0)  # compiles, before a flight
        self._number = len(list(self.folder.glob("[0-9]*.jpg")))

    def take(self, vehicle: Vehicle, time_s: float) -> Path:
        """Photograph what the vehicle sees now, ``time_s`` after the beginning; returns the file."""
        name = f"{self._number:05d}.jpg"
        pixels = self._exposed(vehicle)
        fix = geodetic_from_enu(vehicle.fix(), self.origin)
        taken_at = _BEGAN + timedelta(seconds=time_s)
        sidecar = {
            "latitude_deg": fix.latitude_deg,
            "longitude_deg": fix.longitude_deg,
            "altitude_m": fix.altitude_m,
            "yaw_deg": vehicle.yaw_deg,
            "pitch_deg": vehicle.pitch_deg,
            "captured_at": taken_at.isoformat(),
        }
        path = self.folder / name
        # The sidecar first: who finds the photograph finds all that is known of it.
        with replacing(path.with_name(f"{name}.json")) as temporary:
            temporary.write_text(json.dumps(sidecar), encoding="utf-8")
        with replacing(path) as temporary:
            Image.fromarray(pixels).save(
                temporary, format="JPEG", quality=_JPEG_QUALITY, exif=self._exif(fix, taken_at)
            )
        self._number += 1
        return path

    def _exposed(self, vehicle: Vehicle) -> np.ndarray:
        """The mean of photographs along the way that the vehicle flies in the exposure time."""
        still = float(np.linalg.norm(vehicle.velocity)) * self.exposure_s <= _BLURRED_M
        ways = [0.0] if still else (np.linspace(-0.5, 0.5, _EXPOSURES) * self.exposure_s).tolist()
        total = np.zeros((self.camera.camera.height, self.camera.camera.width, 3))
        for index, after_s in enumerate(ways):
            position = (vehicle.position + vehicle.velocity * after_s) / self.scale
            pose = camera_at(position, vehicle.yaw_deg, vehicle.pitch_deg)
            total += self.camera.photograph(
                self._packed, pose, (self.seed * 1_000_003 + self._number) * _EXPOSURES + index
            )
        return np.round(total / len(ways)).astype(np.uint8)

    def _exif(self, fix: GeodeticPosition, taken_at: datetime) -> Image.Exif:
        exif = Image.Exif()
        camera = self.camera.camera
        more = exif.get_ifd(_EXIF_IFD)
        more[_FOCAL_LENGTH_35MM] = round(36.0 * camera.fx / camera.width)
        more[_TAKEN_AT] = taken_at.strftime("%Y:%m:%d %H:%M:%S")
        gps = exif.get_ifd(_GPS_IFD)
        gps[1], gps[2] = "N" if fix.latitude_deg >= 0 else "S", _sexagesimal(abs(fix.latitude_deg))
        gps[3], gps[4] = "E" if fix.longitude_deg >= 0 else "W", _sexagesimal(abs(fix.longitude_deg))
        gps[5], gps[6] = (b"\0" if fix.altitude_m >= 0 else b"\1"), abs(fix.altitude_m)
        return exif


def _sexagesimal(degrees: float) -> tuple[float, float, float]:
    minutes = degrees % 1.0 * 60.0
    return float(int(degrees)), float(int(minutes)), minutes % 1.0 * 60.0
