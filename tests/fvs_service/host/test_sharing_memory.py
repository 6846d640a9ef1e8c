"""Scenes that share a worker's memory, and two workers that share scenes."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

pytestmark = pytest.mark.timeout(900)

RUNNER = "fvs_service.host.runner.process"


@pytest.mark.slow
def test_more_scenes_than_fit_take_turns(
    serving: Callable[..., Any], tmp_path: Path, courtyard_photographs: list[Path]
) -> None:
    """Room for one scene at a time: the other jobs wait, and a ranking makes room for its scene."""
    room = {"FVS_WORKER__MEMORY_BYTES": "1", "FVS_WORKER__JOBS_AT_ONCE": "3"}
    with serving(tmp_path / "root", room) as service:
        scenes = [service.scene() for _ in range(3)]
        for scene in scenes:
            service.send(scene, courtyard_photographs[:7])
        jobs = [service.start(scene) for scene in scenes]
        most = 0
        while any(service.job(job)["state"] in ("queued", "running") for job in jobs):
            most = max(most, len(service.processes(RUNNER)))
            time.sleep(0.1)
        assert [service.job(job)["state"] for job in jobs] == ["succeeded"] * 3
        assert most == 1
        for scene in scenes:
            assert service.rank(scene)["candidates"]
            assert len(service.processes(RUNNER)) == 1


@pytest.mark.slow
def test_idle_scenes_are_unloaded_and_warmed_again_by_any_worker(
    serving: Callable[..., Any], tmp_path: Path, courtyard_photographs: list[Path]
) -> None:
    short = {"FVS_WORKER__IDLE_S": "1", "FVS_WORKER__COUNT": "2"}
    with serving(tmp_path / "root", short) as service:
        scene = service.scene()
        service.send(scene, courtyard_photographs[:7])
        service.finish(service.start(scene))
        for _ in range(2):
            deadline = time.monotonic() + 30
            while service.processes(RUNNER):
                assert time.monotonic() < deadline
                time.sleep(0.1)
            assert service.rank(scene)["candidates"]
            assert len(service.processes(RUNNER)) == 1


@pytest.mark.slow
def test_images_start_updates_by_themselves_and_place_the_scene_in_the_world(
    service: Any, courtyard_photographs: list[Path]
) -> None:
    """With a policy and positions: nobody asks for a job, and rankings are in metres."""
    from fvs_engine.lab.simulate import orbit

    scene = service.scene(world={"kind": "local"}, policy={"trigger": "each-image", "first": 7})
    places = [pose.translation for pose in orbit(9, turns=0.36)]  # as the photographs
    for file, (x, y, z) in zip(courtyard_photographs, places, strict=True):
        service.send(scene, [file], x_m=x, y_m=y, z_m=z)
    deadline = time.monotonic() + 240
    while True:
        found = service.client.get(f"/v1/scenes/{scene}").json()
        jobs = service.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]
        if found["image_counts"]["pending"] == 0 and all(job["state"] == "succeeded" for job in jobs):
            break
        assert time.monotonic() < deadline, (found, jobs)
        time.sleep(0.2)
    assert 1 <= len(jobs) <= 3
    alignment = found["alignment"]
    assert alignment["status"] == "aligned"
    assert alignment["inliers"] >= 7
    assert alignment["rms_m"] < 0.05
    pose = {"frame": "world", "position": places[0].tolist(), "orientation_wxyz": [1, 0, 0, 0]}
    ranking = service.rank(scene, current_pose=pose, radius_m=50.0)
    distances = [place["distance_m"] for place in ranking["candidates"]]
    assert all(0 < distance < 7 for distance in distances)
