"""A worker that is frozen for longer than its lease, and continued when another one ranks with its scene."""

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


def _freeze_in_training(service: Any, scene: str, job: str) -> None:
    """Freeze the worker that trains the job's full model until the other one has ranked with the scene."""
    service.wait(job, lambda found: found["stage"] == "training")
    (runner,) = service.processes(RUNNER)
    frozen = _parent(runner)
    _freeze(service, frozen)
    try:
        # Nobody extends the lease any more, so the runner ends; the other worker starts one of its own.
        _until(lambda: runner not in service.processes(RUNNER))
        assert service.rank(scene)["candidates"]
        (other,) = service.processes(RUNNER)
        assert _parent(other) != frozen
        assert service.job(job)["state"] == "running"
    finally:
        os.kill(frozen, signal.SIGCONT)
    assert service.finish(job)["attempt"] == 1
    assert frozen in service.processes(WORKER)


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
        made = []
        for request in ({"kind": "update"}, {"kind": "fine", "iterations": 200}):
            job = service.start(scene, **request)
            _freeze_in_training(service, scene, job)
            made.append(_models(service, scene, job))
        assert made == expected
