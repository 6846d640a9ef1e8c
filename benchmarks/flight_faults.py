"""Flights with faults: every one ends at home, with every photograph in the service once.

python benchmarks/flight_faults.py OUT [--runs 20]

Service, simulated copter and ``fvs-client fly`` are processes. What goes wrong, and when, is drawn from the
seed. After a flight whose program or service is gone, the service is started again, and
``fvs-client spool send`` sends what waits, as a pilot would. A run whose result is in OUT is not flown again.
"""

import argparse
import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from contextlib import ExitStack, closing
from hashlib import sha256
from pathlib import Path
from typing import Any

from flights import FIELD, HOME, WORLD, copter
from fvs_client import Client
from fvs_client.fly.vehicle import Vehicle
from rich.console import Console
from rich.table import Table

from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic

BIN = Path(sys.executable).parent
KINDS = (
    "none",
    "service killed",
    "service away",
    "photograph fails",
    "battery",
    "program killed",
    "link lost",
    "link interrupted",
)
SURVEY_VIEWS, VIEWS = 8, 11
SPEED_UP = 20
PATIENCE_S = 40
"""How long the vehicle waits for its next view, in its own time divided by ``SPEED_UP``."""
AWAY_S = (2.0, 12.0)
AT_HOME_M = 4.0
LANDS_WITHIN_S = 240.0
SENDS_WITHIN_S = "120"
console = Console()


class Service:
    """``fvs serve`` with its data in ``root``, on one port, as a group of processes that can be killed."""

    def __init__(self, root: Path, log: Path) -> None:
        with socket.create_server(("127.0.0.1", 0)) as free:
            self._port = free.getsockname()[1]
        self._root, self._log = root, log
        self.url = f"http://127.0.0.1:{self._port}"
        self.start()

    def start(self) -> None:
        """Start it; returns once it answers."""
        command = [str(BIN / "fvs"), "serve", "--root", str(self._root), "--port", str(self._port)]
        with self._log.open("a") as log:
            self._process = subprocess.Popen(
                command, stdout=subprocess.PIPE, stderr=log, text=True, start_new_session=True
            )
        assert self._process.stdout is not None
        if not self._process.stdout.readline().strip():
            raise SystemExit(f"The service did not start: see {self._log}")

    def kill(self) -> None:
        """End all of its processes at once, as a power failure does."""
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait()

    def stop(self) -> None:
        """End it in order."""
        if self._process.poll() is None:
            self._process.terminate()
            self._process.wait()


class Relay:
    """TCP between a ground station and the vehicle, which can be cut and restored."""

    def __init__(self, port: int) -> None:
        self._server = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp:127.0.0.1:{self._server.getsockname()[1]}"
        self._port, self._cut, self._open = port, threading.Event(), [self._server]
        threading.Thread(target=self._accept, daemon=True).start()

    def cut(self) -> None:
        """Pass nothing on: what is sent is lost, as over radio."""
        self._cut.set()

    def restore(self) -> None:
        """Pass on what is sent from now on."""
        self._cut.clear()

    def close(self) -> None:
        """Close all connections."""
        for one in self._open:
            with contextlib.suppress(OSError):
                one.shutdown(socket.SHUT_RDWR)
            one.close()

    def _accept(self) -> None:
        while True:
            try:
                near, _ = self._server.accept()
                far = socket.create_connection(("127.0.0.1", self._port))
            except OSError:
                return
            self._open += [near, far]
            for source, target in ((near, far), (far, near)):
                threading.Thread(target=self._pass, args=(source, target), daemon=True).start()

    def _pass(self, source: socket.socket, target: socket.socket) -> None:
        try:
            while data := source.recv(65_536):
                if not self._cut.is_set():
                    target.sendall(data)
            target.shutdown(socket.SHUT_WR)
        except OSError:
            pass


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("out", type=Path)
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    results = []
    for number in range(options.runs):
        path = options.out / f"{number:02d}.json"
        if not path.exists():
            result = _run(
                KINDS[number % len(KINDS)], random.Random(f"{options.seed}-{number}"), options.out, number
            )
            path.write_text(json.dumps(result, indent=1))
        results.append(json.loads(path.read_text()))
    _show(results)
    if not all(result["safe"] and result["complete"] for result in results):
        raise SystemExit(1)


def _run(kind: str, chance: random.Random, out: Path, number: int) -> dict[str, Any]:
    """Fly once with a fault; returns how it ended."""
    log = out / f"{number:02d}.jsonl"
    log.unlink(missing_ok=True)
    after = chance.randrange(2, VIEWS)
    arguments = ["--size", "480", "360", "--speed-up", str(SPEED_UP), "--seed", str(number), *FIELD]
    arguments += ["--endurance", str(chance.randrange(250, 450) if kind == "battery" else 90_000)]
    if kind == "photograph fails":
        arguments += ["--fail", str(after + 1)]  # the first is the test photograph before takeoff
    with tempfile.TemporaryDirectory(prefix="fvs-faults-") as name, ExitStack() as stack:
        folder = Path(name)
        camera = folder / "camera"
        service = Service(folder / "service", out / f"{number:02d}-service.log")
        stack.callback(service.stop)
        url = stack.enter_context(copter(camera, out / f"{number:02d}-copter.log", arguments))
        relay = stack.enter_context(closing(Relay(int(url.rsplit(":", 1)[1]))))
        with Client(service.url) as client:
            scene_id = client.scenes.create("flight", world=WORLD).id
        began = time.monotonic()
        with (out / f"{number:02d}-fly.log").open("w") as output:
            program = subprocess.Popen(
                _command(service.url, scene_id, relay.url, camera, log), stdout=output, stderr=output
            )
        stack.callback(_end, program)
        _wait_for_photographs(log, after, program)
        time.sleep(chance.uniform(0.0, 6.0))
        _break(kind, chance, service, relay, program)
        status = program.wait()
        relay.close()  # the vehicle speaks with one station at a time
        landed_m, battery = _landing(url)
        seconds = time.monotonic() - began
        if kind == "service away":
            service.start()
        sent = subprocess.run(
            [
                str(BIN / "fvs-client"),
                "--url",
                service.url,
                "spool",
                "send",
                str(camera),
                "--timeout",
                SENDS_WITHIN_S,
            ],
            capture_output=True,
            text=True,
            check=False,
        )
        taken = Counter(f"sha256:{sha256(path.read_bytes()).hexdigest()}" for path in _photographs(camera))
        with Client(service.url) as client:
            kept = Counter(image.digest for image in client.scenes.get(scene_id).images.list())
    return {
        "kind": kind,
        "after": after,
        "exit_status": status,
        "ending": _ending(log),
        "safe": landed_m is not None and landed_m <= AT_HOME_M,
        "landed_m": landed_m,
        "battery": battery,
        "photographs": sum(taken.values()),
        "in_service": sum(kept.values()),
        "complete": kept == taken and sum(taken.values()) >= after and sent.returncode == 0,
        "seconds": seconds,
    }


def _photographs(camera: Path) -> list[Path]:
    """The photographs of a flight, without the test photograph before takeoff, which is not sent."""
    return sorted(camera.glob("*.jpg"))[1:]


def _command(url: str, scene_id: str, vehicle: str, camera: Path, log: Path) -> list[str]:
    survey = f"{HOME.latitude_deg},{HOME.longitude_deg},30,13"
    program = [str(BIN / "fvs-client"), "--url", url, "fly", scene_id, "--yes", "--vehicle", vehicle]
    program += ["--photographs", str(camera), "--log", str(log), "--views", str(VIEWS), "--method", "kriging"]
    program += [
        "--generator",
        "orbit",
        "--radius",
        "18",
        "--lowest",
        "3",
        "--iterations",
        "300",
        "--long-side",
        "240",
    ]
    program += ["--survey", survey, "--survey-target", "5", "--survey-views", str(SURVEY_VIEWS)]
    return [*program, "--patience", str(PATIENCE_S * SPEED_UP)]


def _break(
    kind: str, chance: random.Random, service: Service, relay: Relay, program: "subprocess.Popen[bytes]"
) -> None:
    """Have it go wrong."""
    match kind:
        case "service killed":
            service.kill()
            time.sleep(chance.uniform(*AWAY_S))
            service.start()
        case "service away":
            service.kill()
        case "program killed":
            program.kill()
        case "link lost":
            relay.cut()
        case "link interrupted":
            relay.cut()
            time.sleep(chance.uniform(*AWAY_S))
            relay.restore()


def _wait_for_photographs(log: Path, count: int, program: "subprocess.Popen[bytes]") -> None:
    while program.poll() is None and sum(event["event"] == "photograph" for event in _events(log)) < count:
        time.sleep(0.2)


def _landing(url: str) -> tuple[float | None, float | None]:
    """How far from home the vehicle has landed, in m, and what its battery has left; None: it has not."""
    with Vehicle(url) as vehicle:
        until = time.monotonic() + LANDS_WITHIN_S
        while vehicle.state.armed and time.monotonic() < until:
            time.sleep(0.2)
        time.sleep(0.5)
        state = vehicle.state
    if state.armed:
        return None, state.battery
    place = GeodeticPosition(state.latitude_deg, state.longitude_deg, HOME.altitude_m)
    east, north, _ = enu_from_geodetic(place, HOME)
    return float((east**2 + north**2) ** 0.5), state.battery


def _events(log: Path) -> list[dict[str, Any]]:
    if not log.exists():
        return []
    return [json.loads(line) for line in log.read_text().splitlines() if line.endswith("}")]


def _ending(log: Path) -> str:
    return next((event["ending"] for event in _events(log) if event["event"] == "ends"), "")


def _end(program: "subprocess.Popen[bytes]") -> None:
    if program.poll() is None:
        program.kill()
        program.wait()


def _show(results: list[dict[str, Any]]) -> None:
    table = Table("fault", "after", "ending", "landed, m", "battery", "photographs", "in the service", "s")
    for result in results:
        table.add_row(
            result["kind"],
            str(result["after"]),
            result["ending"] or "(killed)",
            "not" if result["landed_m"] is None else f"{result['landed_m']:.1f}",
            f"{result['battery']:.0%}",
            str(result["photographs"]),
            f"{result['in_service']}{'' if result['complete'] else ' (!)'}",
            f"{result['seconds']:.0f}",
        )
    console.print(table)
    safe, complete = (sum(result[key] for result in results) for key in ("safe", "complete"))
    console.print(
        f"{safe} of {len(results)} landed at home, {complete} with every photograph in the service once."
    )


if __name__ == "__main__":
    main()
