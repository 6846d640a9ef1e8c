"""The whole service in processes of its own, on a small synthetic scene."""

import contextlib
import hashlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx2
import pytest

from fvs_engine.lab.simulate import SimulatedCamera, courtyard, orbit, write_photographs
from fvs_engine.monitor import Monitor

ENDED = ("succeeded", "failed", "canceled")

SMALL = {
    "FVS_WORKER__INITIAL_ITERATIONS": "120",
    "FVS_WORKER__ITERATIONS_PER_IMAGE": "20",
    "FVS_WORKER__LONG_SIDE_PX": "160",
    "FVS_WORKER__THREADS": "1",
    "FVS_LEASE_S": "10",
    "FVS_SWEEP_S": "1",
    "FVS_INSPECTORS": "1",
}


@dataclass
class Service:
    """A running ``fvs serve`` and a client for it."""

    root: Path
    client: httpx2.Client
    process: "subprocess.Popen[str]"

    def scene(self, **request: Any) -> str:
        """A new scene's id."""
        made = self.client.post("/v1/scenes", json={"name": "courtyard", **request})
        assert made.status_code == 201, made.text
        return made.json()["id"]

    def send(self, scene: str, photographs: list[Path], **metadata: Any) -> None:
        """Upload photographs."""
        for file in photographs:
            content = file.read_bytes()
            digest = hashlib.sha256(content).hexdigest()
            answer = self.client.put(
                f"/v1/scenes/{scene}/images/sha256:{digest}",
                content=content,
                params={"name": file.name, **metadata},
            )
            assert answer.status_code in (200, 201), answer.text

    def start(self, scene: str, kind: str = "update", **request: Any) -> str:
        """A new job's id."""
        made = self.client.post(f"/v1/scenes/{scene}/jobs", json={"kind": kind, **request})
        assert made.status_code == 202, made.text
        return made.json()["id"]

    def job(self, job: str) -> dict[str, Any]:
        """The job as it is now."""
        return self.client.get(f"/v1/jobs/{job}").json()

    def wait(
        self, job: str, until: Callable[[Mapping[str, Any]], bool], timeout_s: float = 240
    ) -> dict[str, Any]:
        """The job once ``until`` holds of it; its progress must not fall on the way."""
        deadline, progress = time.monotonic() + timeout_s, 0.0
        while True:
            found = self.job(job)
            assert found["progress"] >= progress
            progress = found["progress"]
            if until(found):
                return found
            assert found["state"] not in ENDED, found["error"] or found
            assert time.monotonic() < deadline, found
            time.sleep(0.2)

    def finish(self, job: str) -> dict[str, Any]:
        """The job once it has succeeded."""
        return self.wait(job, lambda found: found["state"] == "succeeded")

    def rank(self, scene: str, **request: Any) -> dict[str, Any]:
        """A ranking of poses around the scene; asked again as often as the service says so."""
        asked = {"generator": {"kind": "orbit", "count": 4}, **request}
        deadline = time.monotonic() + 150
        while True:
            made = self.client.post(f"/v1/scenes/{scene}/rankings", json=asked)
            if made.status_code == 201:
                return made.json()
            assert made.json()["retryable"], made.text
            assert time.monotonic() < deadline, made.text
            time.sleep(0.2)

    def snapshot(self, snapshot: str) -> dict[str, Any]:
        """A snapshot."""
        return self.client.get(f"/v1/snapshots/{snapshot}").json()

    def processes(self, command: str) -> list[int]:
        """The ids of the processes below the supervisor whose command line has ``command``."""
        parents = dict(_running())
        found = []
        for pid in parents:
            ancestor = pid
            while ancestor in parents and ancestor != self.process.pid:
                ancestor = parents[ancestor]
            if ancestor == self.process.pid and pid != ancestor and command in _command(pid):
                found.append(pid)
        return found


def _running() -> Iterator[tuple[int, int]]:
    for folder in Path("/proc").iterdir():
        if folder.name.isdigit():
            with contextlib.suppress(OSError, IndexError):
                yield int(folder.name), int((folder / "stat").read_text().rsplit(")", 1)[1].split()[1])


def _command(pid: int) -> str:
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode().replace("\0", " ")
    return ""


@contextlib.contextmanager
def _serving(root: Path, environment: Mapping[str, str]) -> Iterator[Service]:
    log = root.with_suffix(".log")
    with log.open("w") as err:
        process = subprocess.Popen(
            [
                *(sys.executable, "-c", "from fvs_engine.cli import main; main()", "serve"),
                *("--root", str(root), "--port", "0", "--log-json"),
            ],
            stdout=subprocess.PIPE,
            stderr=err,
            text=True,
            env={**os.environ, **SMALL, **environment},
        )
    assert process.stdout is not None
    with process, process.stdout:
        try:
            url = process.stdout.readline().strip()
            assert url.startswith("http://"), log.read_text()
            with httpx2.Client(base_url=url, timeout=120) as client:
                yield Service(root, client, process)
        finally:
            process.send_signal(signal.SIGTERM)
            assert process.wait(30) == 0, log.read_text()


@pytest.fixture(scope="session")
def serving() -> Callable[..., contextlib.AbstractContextManager[Service]]:
    """Run a service in a ``with`` block: a folder, and changes to its environment."""
    return _serving


@pytest.fixture(scope="session")
def service(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Service]:
    """A service that all tests share; each makes scenes of its own."""
    with _serving(tmp_path_factory.mktemp("service") / "root", {}) as service:
        yield service


@pytest.fixture(scope="session")
def courtyard_photographs(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Nine photographs along an arc around the courtyard."""
    folder = tmp_path_factory.mktemp("courtyard")
    camera = SimulatedCamera.like_a_drone(320, 240)
    return write_photographs(folder, courtyard(), camera, orbit(9, turns=0.36), Monitor())


@pytest.fixture(scope="session")
def modelled(service: Service, courtyard_photographs: list[Path]) -> str:
    """A scene with a model of the first five photographs; tests may rank in it, and add to it."""
    scene = service.scene()
    service.send(scene, courtyard_photographs[:5])
    service.finish(service.start(scene))
    return scene
