"""SIGTERM to the service in the middle of everything: it ends in time, and jobs continue."""

import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fvs_service.serving.process_tree import command_of, descendants

ENDS_WITHIN_S = 8.0
RUNNER = "fvs_service.host.runner.process"
Record = Callable[[str, object], None]


def stop(process: "subprocess.Popen[str]", number: signal.Signals = signal.SIGTERM) -> float:
    """Send the signal to the service; returns the time until its last process has ended."""
    tree = {pid: command_of(pid) for pid in descendants(process.pid)}
    assert any("serving.process" in command for command in tree.values())
    began = time.monotonic()
    process.send_signal(number)
    process.wait(60)
    took_s = time.monotonic() - began
    left = [command for pid, command in tree.items() if command and command_of(pid) == command]
    assert not left
    return took_s


def until(condition: Callable[[], object], timeout_s: float = 600.0) -> None:
    deadline = time.monotonic() + timeout_s
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def stage(service: Any, job: str) -> str | None:
    found = service.job(job)
    assert found["state"] not in ("failed", "canceled"), found
    return "done" if found["state"] == "succeeded" else found["stage"]


@contextlib.contextmanager
def busy_connections(service: Any, scene: str) -> Iterator[None]:
    """A stream of events, and an upload whose bytes drip in."""
    url = service.client.base_url
    with (
        socket.create_connection((url.host, url.port)) as stream,
        socket.create_connection((url.host, url.port)) as upload,
    ):
        stream.sendall(f"GET /v1/scenes/{scene}/events HTTP/1.1\r\nHost: {url.host}\r\n\r\n".encode())
        assert stream.recv(1000).startswith(b"HTTP/1.1 200")
        path = f"/v1/scenes/{scene}/images/sha256:{'0' * 64}"
        upload.sendall(
            f"PUT {path} HTTP/1.1\r\nHost: {url.host}\r\nContent-Length: 100000\r\n\r\nabc".encode()
        )
        ended = threading.Event()
        drops = threading.Thread(target=_drip, args=(upload, ended))
        drops.start()
        try:
            yield
        finally:
            ended.set()
            drops.join()


def _drip(upload: socket.socket, ended: threading.Event) -> None:
    with contextlib.suppress(OSError):
        while not ended.wait(0.2):
            upload.sendall(b"x")


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_sigterm_ends_everything_in_time_and_jobs_continue(
    serving: Any, courtyard_photographs: list[Path], tmp_path: Path, record_property: Record
) -> None:
    root, took_s = tmp_path / "root", {}
    environment = {"FVS_WORKER__INITIAL_ITERATIONS": "400", "FVS_DRAIN_S": "0.5"}

    def ended(what: str, seconds: float) -> None:
        took_s[what] = round(seconds, 2)
        record_property(what, seconds)
        print(what, took_s[what], flush=True)  # noqa: T201 - what was measured

    with serving(root, environment) as service:
        scene = service.scene()
        with busy_connections(service, scene):
            ended("an upload in progress and a stream of events", stop(service.process))
    with serving(root, environment) as service:
        service.send(scene, courtyard_photographs[:7])
        job = service.start(scene)
        until(lambda: service.processes(RUNNER))
        ended("a runner starting", stop(service.process))
    with serving(root, {**environment, "NUMBA_CACHE_DIR": str(tmp_path / "kernels")}) as service:
        until(lambda: service.processes("fvs_engine.compilation.child"))
        time.sleep(1)
        ended("kernels being compiled", stop(service.process))
    with serving(root, environment) as service:
        until(lambda: service.processes("fvs_engine.sfm.native.child"))
        ended("structure from motion", stop(service.process))
    with serving(root, environment) as service:
        until(
            lambda: (
                stage(service, job) in ("quick-training", "training") and service.job(job)["progress"] > 0.5
            )
        )
        ended("training", stop(service.process))
    with serving(root, environment) as service:
        until(lambda: stage(service, job) in ("snapshot", "done"))
        ended("a job being committed", stop(service.process))
    with serving(root, environment) as service:
        service.finish(job)
        service.rank(scene)
        asking = threading.Thread(target=_ask_for_much, args=(service.client.base_url, scene))
        asking.start()
        until(lambda: "fvs_rankings_open 1.0" in service.client.get("/metrics").text)
        time.sleep(0.5)
        ended("a ranking", stop(service.process, signal.SIGINT))
        asking.join()
    with serving(root, environment) as service:
        assert service.rank(scene)["candidates"]
    assert max(took_s.values()) < ENDS_WITHIN_S, took_s


def _ask_for_much(url: httpx2.URL, scene: str) -> None:
    with contextlib.suppress(httpx2.HTTPError), httpx2.Client(base_url=url, timeout=120) as client:
        generator = {"kind": "orbit", "count": 2000}
        client.post(f"/v1/scenes/{scene}/rankings", json={"generator": generator})


@pytest.mark.process
def test_a_frozen_worker_does_not_keep_the_service_from_ending(tmp_path: Path) -> None:
    """The part of the service on a machine for workers, which starts sooner than the whole."""
    program = "from fvs_engine.cli import main; main()"
    command = [sys.executable, "-c", program, "serve", "--port", "0", "--root", str(tmp_path / "root")]

    def worker() -> int | None:
        found = (pid for pid in descendants(process.pid) if "process worker" in command_of(pid))
        return next(found, None)

    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, text=True
    ) as process:
        try:
            until(worker)
            frozen = worker()
            assert frozen is not None
            os.kill(frozen, signal.SIGSTOP)
            assert stop(process) < ENDS_WITHIN_S
        finally:
            process.kill()
