"""A simulated vehicle behind a real MAVLink connection."""

import select
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest
from fvs_client import AltitudeDatum, Client, EnuWorld, Origin, Scene
from simulators import Simulator

from fvs_engine.lab.simulate.mavlink.dialect import mavlink


class Relay:
    """Stands between a simulator and those who connect to ``url``: ``edit`` changes what the vehicle says.

    It gets each message, and returns those that are passed on. While ``cut`` is true, nothing is.
    """

    def __init__(self, upstream: str) -> None:
        _, host, port = upstream.split(":")
        self._upstream = (host, int(port))
        self._listen = socket.create_server(("127.0.0.1", 0))
        self._listen.settimeout(0.1)
        self.url = f"tcp:127.0.0.1:{self._listen.getsockname()[1]}"
        self.edit: Callable[[Any], list[Any]] = lambda message: [message]
        self.cut = False
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._stop.set()
        self._thread.join()
        self._listen.close()

    def _run(self) -> None:
        while not self._stop.is_set():
            try:
                client, _ = self._listen.accept()
            except TimeoutError:
                continue
            with client, socket.create_connection(self._upstream) as vehicle, suppress(OSError):
                self._pass(client, vehicle)

    def _pass(self, client: socket.socket, vehicle: socket.socket) -> None:
        parser = mavlink.MAVLink(None)
        parser.robust_parsing = True
        while not self._stop.is_set():
            for ready in select.select([client, vehicle], [], [], 0.05)[0]:
                data = ready.recv(4096)
                if not data:
                    return
                if self.cut:
                    continue
                if ready is client:
                    vehicle.sendall(data)
                    continue
                for message in parser.parse_buffer(data) or ():
                    for passed in self.edit(message):
                        client.sendall(bytes(passed.get_msgbuf()))


@pytest.fixture(autouse=True)
def _quick_vehicles(monkeypatch: pytest.MonkeyPatch) -> None:
    """Shorten timeouts: the simulated vehicle sends every message ten times a second."""
    monkeypatch.setattr("fvs_client.fly.link._OTHERS_S", 0.4)
    monkeypatch.setattr("fvs_client.fly.connection._EQUIPMENT_S", 0.4)
    monkeypatch.setattr("fvs_client.fly.equipment._BATTERY_S", 0.5)
    monkeypatch.setattr("fvs_client.fly.equipment._PHOTOGRAPH_S", 60.0)  # it ends when the file comes


@pytest.fixture
def relay() -> Iterator[Callable[[str], Relay]]:
    """Put a relay in front of a simulator's URL."""
    with ExitStack() as stack:

        def between(upstream: str) -> Relay:
            made = Relay(upstream)
            stack.callback(made.close)
            return made

        yield between


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


@pytest.fixture
def scene(client: Client) -> Scene:
    """A scene whose world begins at the vehicle's home."""
    home = Origin(
        latitude_deg=47.3769, longitude_deg=8.5417, altitude_m=440.0, altitude_datum=AltitudeDatum.SEA_LEVEL
    )
    return client.scenes.create("flight", world=EnuWorld(origin=home))
