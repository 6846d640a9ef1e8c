"""The camera of a simulated vehicle: photographs with motion blur, GPS in their EXIF, and a sidecar."""

import json
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from PIL.ExifTags import IFD, Base

from fvs_engine.errors import InvalidInputError
from fvs_engine.files.atomic import replacing
from fvs_engine.geometry.geodetic import GeodeticPosition, camera_at, geodetic_from_enu
from fvs_engine.images.metadata import PhotographPriors
from fvs_engine.images.written_priors import prior_tags
from fvs_engine.lab.simulate.camera import SimulatedCamera
from fvs_engine.lab.simulate.scenery import Scenery
from fvs_engine.lab.simulate.vehicle import Vehicle

_JPEG_QUALITY = 92
_EXPOSURES = 3
"""Places on the way whose light is averaged for the blur of one photograph."""
_BLURRED_M = 0.005
"""Way in the exposure time from which a photograph is blurred."""
_MIDDLE_GREY, _DARK, _MOST_EV = 0.18, 1e-3, 4.0
_BEGAN = datetime(2026, 1, 1, 12, tzinfo=UTC)


@dataclass
class VehicleCamera:
    """Photographs a ``scenery``, in ENU metres around ``origin``, into ``folder``.

    Files are named in order. EXIF and the sidecar, ``NAME.jpg.json``, have the receiver's fix, yaw and pitch.
    ``exposure_s`` blurs what moves. With ``auto_exposure`` the camera brings each photograph to the same
    brightness, as cameras do that nobody set. ``sensor`` has the scenery's lens. ``truth`` is a file of lines
    of JSON with what no real camera knows: where each photograph really was taken, and how far the vehicle
    had flown.
    """

    folder: Path
    scenery: Scenery
    origin: GeodeticPosition
    sensor: SimulatedCamera
    exposure_s: float = 0.004
    auto_exposure: bool = False
    truth: Path | None = None
    seed: int = 0

    def __post_init__(self) -> None:
        if self.sensor.camera != self.scenery.camera:
            raise InvalidInputError("The sensor of a vehicle's camera has the lens of its scenery.")
        self.scenery.light(camera_at(np.ones(3), 0.0, 0.0))  # compiles, before a flight
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
        # The sidecar first: a photograph that exists has its metadata.
        with replacing(path.with_name(f"{name}.json")) as temporary:
            temporary.write_text(json.dumps(sidecar), encoding="utf-8")
        position = (fix.latitude_deg, fix.longitude_deg, fix.altitude_m)
        exif, _ = prior_tags(PhotographPriors(*position, captured_at=taken_at))
        camera = self.scenery.camera
        exif.get_ifd(IFD.Exif)[Base.FocalLengthIn35mmFilm] = round(36.0 * camera.fx / camera.width)
        with replacing(path) as temporary:
            Image.fromarray(pixels).save(temporary, format="JPEG", quality=_JPEG_QUALITY, exif=exif)
        self._number += 1
        if self.truth is not None:
            self._tell_truth(self.truth, name, vehicle)
        return path

    def _tell_truth(self, path: Path, name: str, vehicle: Vehicle) -> None:
        document = {
            "file": name,
            "enu_m": vehicle.position.tolist(),
            "yaw_deg": vehicle.yaw_deg,
            "pitch_deg": vehicle.pitch_deg,
            "flown_m": vehicle.flown_m,
        }
        with path.open("a", encoding="utf-8") as file:
            file.write(json.dumps(document) + "\n")

    def _exposed(self, vehicle: Vehicle) -> NDArray[np.uint8]:
        """The light on the sensor, along the way that the vehicle flies in the exposure time."""
        still = float(np.linalg.norm(vehicle.velocity)) * self.exposure_s <= _BLURRED_M
        ways = [0.0] if still else (np.linspace(-0.5, 0.5, _EXPOSURES) * self.exposure_s).tolist()
        light = np.mean([self._light(vehicle, after_s) for after_s in ways], axis=0)
        sensor = self.sensor
        if self.auto_exposure:
            exposure_ev = float(np.log2(_MIDDLE_GREY / max(float(light.mean()), _DARK)))
            sensor = replace(sensor, exposure_ev=float(np.clip(exposure_ev, -_MOST_EV, _MOST_EV)))
        return sensor.develop(light, self.seed * 1_000_003 + self._number)

    def _light(self, vehicle: Vehicle, after_s: float) -> NDArray[np.float64]:
        position = vehicle.position + vehicle.velocity * after_s
        return self.scenery.light(camera_at(position, vehicle.yaw_deg, vehicle.pitch_deg))
