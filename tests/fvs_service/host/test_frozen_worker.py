"""A worker that is frozen for longer than its lease, and continued when another one has its scene."""

import contextlib
import os
import signal
import sqlite3
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

RUNNER = "fvs_service.host.runner.process"
WORKER = "fvs_service.serving.process worker"


def _parent(pid: int) -> int:
    return int(Path(f"/proc/{pid}/stat").read_text().rsplit(")", 1)[1].split()[1])


def _until(holds: Callable[[], Any], timeout_s: float = 120) -> Any:
    """What ``holds`` returns as soon as it is true."""
    deadline = time.monotonic() + timeout_s
    while not (found := holds()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    return found


def _freeze(service: Any, worker: int) -> None:
    """Stop the process, but not within a transaction: SQLite's lock would stop all others with it."""
    while True:
        os.kill(worker, signal.SIGSTOP)
        try:
            with contextlib.closing(sqlite3.connect(service.root / "fvs.sqlite3", timeout=2)) as database:
                database.execute("BEGIN IMMEDIATE")
                database.rollback()
        except sqlite3.OperationalError:
            os.kill(worker, signal.SIGCONT)
            time.sleep(0.01)
        else:
            return


def _freeze_in_training(service: Any, job: str) -> int:
    """Freeze the worker that trains; returns it when another one does."""
    service.wait(job, lambda found: found["stage"] in ("quick-training", "training"))
    (runner,) = service.processes(RUNNER)
    frozen = _parent(runner)
    _freeze(service, frozen)
    # Nobody extends the lease any more, so the runner ends; the other worker starts one of its own.
    _until(lambda: any(pid != runner for pid in service.processes(RUNNER)))
    assert runner not in service.processes(RUNNER)
    assert service.job(job)["state"] == "running"
    return frozen


def _models(service: Any, scene: str, job: str) -> list[str]:
    """The digests of what the job made, in order."""
    snapshots = service.client.get(f"/v1/scenes/{scene}/snapshots").json()["items"]
    made = (snapshot["artifacts"] for snapshot in reversed(snapshots) if snapshot["job_id"] == job)
    return [item["sha256"] for artifacts in made for item in artifacts if item["name"] == "point_cloud.ply"]


def test_a_frozen_worker_loses_its_scene_and_commits_nothing(
    serving: Callable[..., Any], tmp_path: Path, courtyard_photographs: list[Path]
) -> None:
    settings = {"FVS_WORKER__COUNT": "2", "FVS_WORKER__IDLE_S": "1", "FVS_LEASE_S": "5"}
    with serving(tmp_path / "root", settings) as service:
        undisturbed = service.scene()
        service.send(undisturbed, courtyard_photographs[:7])
        jobs = [service.start(undisturbed)]
        service.finish(jobs[0])
        jobs.append(service.start(undisturbed, "fine", iterations=200))
        service.finish(jobs[1])
        expected = [_models(service, undisturbed, job) for job in jobs]
        assert [len(models) for models in expected] == [2, 1]  # an update's quick and full one
        _until(lambda: not service.processes(RUNNER))

        scene = service.scene()
        service.send(scene, courtyard_photographs[:7])
        update = service.start(scene)
        frozen = _freeze_in_training(service, update)  # for good: the job is done without it
        try:
            assert service.finish(update)["attempt"] == 1
            assert service.rank(scene)["candidates"]
        finally:
            os.kill(frozen, signal.SIGCONT)
        _until(lambda: frozen not in service.processes(WORKER))
        _until(lambda: len(service.processes(WORKER)) == 2)

        fine = service.start(scene, "fine", iterations=200)
        frozen = _freeze_in_training(service, fine)
        os.kill(frozen, signal.SIGCONT)  # while the other works
        assert service.finish(fine)["attempt"] == 1
        _until(lambda: frozen not in service.processes(WORKER))
        # The frozen worker's runner may have trained the full model before the lease ran out: then the other
        # worker publishes no quick one.
        assert _models(service, scene, update) in (expected[0], expected[0][1:])
        assert _models(service, scene, fine) == expected[1]
