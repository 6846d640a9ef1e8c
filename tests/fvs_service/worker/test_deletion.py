"""Scenes that are deleted under the processes of the whole service."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.timeout(900)

RUNNER = "fvs_service.worker.runner.process"


def _until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_a_scene_that_is_deleted_while_its_job_runs_leaves_nothing(
    service: Any, courtyard_photographs: list[Path]
) -> None:
    scene = service.scene()
    service.send(scene, courtyard_photographs[:7])
    job = service.start(scene, iterations=100_000)
    service.wait(job, lambda found: found["stage"] == "train")
    runners = len(service.processes(RUNNER))
    assert service.client.get(f"/v1/scenes/{scene}/size").json()["images_bytes"] > 0
    assert service.client.delete(f"/v1/scenes/{scene}").status_code == 204
    assert service.client.get(f"/v1/jobs/{job}").status_code == 404
    _until(lambda: len(service.processes(RUNNER)) == runners - 1)
    _until(lambda: not list(service.root.glob(f"**/{scene}")))


def test_an_update_without_new_images_keeps_the_snapshot(service: Any, modelled: str) -> None:
    before = service.client.get(f"/v1/scenes/{modelled}").json()["snapshot_id"]
    made = service.snapshot(before)
    done = service.finish(service.start(modelled))
    scene = service.client.get(f"/v1/scenes/{modelled}").json()
    assert scene["snapshot_id"] == before
    if made["kind"] == "update":  # else there may be no snapshot of an update with the same model
        assert done["snapshot_id"] == before
        assert before in done["warnings"][-1]
    assert service.client.get(f"/v1/scenes/{modelled}/size").json()["working_bytes"] > 0
