"""A simulated vehicle behind a real MAVLink connection."""

import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import Any

import pytest

from fvs_engine.choices import Firmware as FirmwareName
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.simulate import SimulatedCamera, courtyard
from fvs_engine.simulate.mavlink.autopilot import Autopilot
from fvs_engine.simulate.mavlink.flight_state import Faults
from fvs_engine.simulate.scenery import MadeUpScenery
from fvs_engine.simulate.vehicle import GpsErrors, Vehicle
from fvs_engine.simulate.vehicle_camera import VehicleCamera

HOME = GeodeticPosition(47.3769, 8.5417, 440.0)


class Simulator:
    """An autopilot in a thread; ``url`` is where it listens."""

    def __init__(
        self,
        folder: Path,
        seed: int,
        firmware: FirmwareName = "ardupilot",
        faults: Faults | None = None,
        **vehicle: Any,
    ) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            port = free.getsockname()[1]
        self.folder, self.url = folder, f"tcp:127.0.0.1:{port}"
        sensor = SimulatedCamera.like_a_drone(64, 48)
        camera = VehicleCamera(
            folder, MadeUpScenery(courtyard(0), sensor.camera, scale=10.0), HOME, sensor, seed=seed
        )
        simulated = Vehicle(**{"gps": GpsErrors(0.0, 0.0), **vehicle})
        self.autopilot = Autopilot(
            f"tcpin:127.0.0.1:{port}",
            simulated,
            camera,
            HOME,
            firmware=firmware,
            faults=faults,
            speed_up=30.0,
        )
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self.autopilot.run, args=(self._stop.is_set,), daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self.autopilot.close()


@pytest.fixture
def simulated(tmp_path: Path) -> Callable[..., AbstractContextManager[Simulator]]:
    """Run a simulator in a ``with`` block; its camera writes into a folder of its ``name``."""

    @contextmanager
    def run(name: str = "camera", seed: int = 0, **vehicle: Any) -> Iterator[Simulator]:
        folder = tmp_path / name
        folder.mkdir(exist_ok=True)
        simulator = Simulator(folder, seed, **vehicle)
        try:
            yield simulator
        finally:
            simulator.close()

    return run
