"""The camera of a simulated vehicle: blur, exposure, and what EXIF and sidecar say."""

import json
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.lab.simulate.camera import SimulatedCamera
from fvs_engine.lab.simulate.vehicle import Goal, GpsErrors, Vehicle
from fvs_engine.lab.simulate.vehicle_camera import VehicleCamera

HOME = GeodeticPosition(-33.5, -70.25, -12.0)
PINHOLE = PinholeCamera(64, 48, 50.0, 50.0, 32.0, 24.0)
SENSOR = SimulatedCamera(PINHOLE, vignetting=0.0, full_well=None, read_noise=0.0)


class Stripes:
    """Light that depends on where east the camera is: a pattern that moves with it."""

    def __init__(self, brightness: float) -> None:
        self.camera, self._brightness = PINHOLE, brightness

    def light(self, world_from_camera: RigidTransform) -> np.ndarray:
        columns = np.arange(PINHOLE.width) + 100.0 * world_from_camera.translation[0]
        row = 0.5 + 0.5 * np.sin(columns)
        return np.broadcast_to((self._brightness * row)[None, :, None], (PINHOLE.height, PINHOLE.width, 3))


def photograph(folder: Path, brightness: float = 0.5, speed_m_s: float = 0.0, **camera: bool) -> np.ndarray:
    vehicle = Vehicle(gps=GpsErrors(0.0, 0.0), velocity=np.array([speed_m_s, 0.0, 0.0]))
    taken = VehicleCamera(folder, Stripes(brightness), HOME, SENSOR, **camera).take(vehicle, 0.0)
    with Image.open(taken) as image:
        return np.asarray(image.convert("RGB"), dtype=np.float64)


def test_what_moves_is_blurred(tmp_path: Path) -> None:
    still, slow, fast = (photograph(tmp_path, speed_m_s=speed).std() for speed in (0.0, 1.0, 6.0))
    assert slow == still  # less than a few millimetres in the exposure time
    assert fast < 0.7 * still


def test_automatic_exposure_brings_dark_and_bright_to_the_same(tmp_path: Path) -> None:
    fixed = [photograph(tmp_path, brightness).mean() for brightness in (0.05, 0.5)]
    assert fixed[1] > 2.0 * fixed[0]
    automatic = [photograph(tmp_path, brightness, auto_exposure=True).mean() for brightness in (0.05, 0.5)]
    assert automatic[0] == pytest.approx(automatic[1], rel=0.02)


def test_photographs_say_where_and_when(tmp_path: Path) -> None:
    camera = VehicleCamera(tmp_path, Stripes(0.5), HOME, SENSOR)
    vehicle = Vehicle(gps=GpsErrors(0.0, 0.0), position=np.array([30.0, 40.0, 5.0]), yaw_deg=75.0)
    vehicle.pitch_deg = -20.0
    files = [camera.take(vehicle, time_s) for time_s in (1.5, 62.0)]
    assert [file.name for file in files] == ["00000.jpg", "00001.jpg"]
    told = json.loads((tmp_path / "00001.jpg.json").read_text())
    assert (told["yaw_deg"], told["pitch_deg"]) == (75.0, -20.0)
    assert told["captured_at"] == "2026-01-01T12:01:02+00:00"
    with Image.open(files[1]) as image:
        gps = image.getexif().get_ifd(0x8825)
        assert image.getexif().get_ifd(0x8769)[0xA405] == round(36 * 50 / 64)
    signed = [
        (-1.0 if gps[tag] in "SW" else 1.0) * sum(float(part) / 60**n for n, part in enumerate(gps[tag + 1]))
        for tag in (1, 3)
    ]
    assert signed == pytest.approx([told["latitude_deg"], told["longitude_deg"]], abs=1e-6)
    assert told["latitude_deg"] == pytest.approx(-33.5 + 40.0 / 110_900.0, abs=1e-6)
    assert (gps[5], float(gps[6])) == (b"\1", pytest.approx(7.0, abs=0.01))  # below the sea


def test_the_truth_is_told_apart(tmp_path: Path) -> None:
    truth = tmp_path / "truth.jsonl"
    vehicle = Vehicle(gps=GpsErrors(5.0, 0.5))
    camera = VehicleCamera(tmp_path, Stripes(0.5), HOME, SENSOR, truth=truth)
    for north_m in (10.0, 20.0):
        for _ in range(2_000):
            vehicle.step(0.05, Goal(np.array([0.0, north_m, 5.0]), 30.0, 5.0))
        camera.take(vehicle, 0.0)
    first, second = (json.loads(line) for line in truth.read_text().splitlines())
    assert (first["file"], second["file"]) == ("00000.jpg", "00001.jpg")
    assert second["enu_m"] == vehicle.position.tolist()
    assert second["yaw_deg"] == pytest.approx(30.0)
    moved_m = np.linalg.norm(np.subtract(second["enu_m"], first["enu_m"]))
    assert 0.8 * moved_m < second["flown_m"] - first["flown_m"] < 2.0 * moved_m
    sidecar = json.loads((tmp_path / "00001.jpg.json").read_text())
    assert "enu_m" not in sidecar


def test_numbers_go_on_after_a_restart(tmp_path: Path) -> None:
    vehicle = Vehicle()
    first = VehicleCamera(tmp_path, Stripes(0.5), HOME, SENSOR).take(vehicle, 0.0)
    second = VehicleCamera(tmp_path, Stripes(0.5), HOME, SENSOR).take(vehicle, 0.0)
    assert (first.name, second.name) == ("00000.jpg", "00001.jpg")


def test_the_sensor_has_the_lens_of_its_scenery(tmp_path: Path) -> None:
    with pytest.raises(InvalidInputError, match="lens"):
        VehicleCamera(tmp_path, Stripes(0.5), HOME, SimulatedCamera.like_a_drone(64, 48))
