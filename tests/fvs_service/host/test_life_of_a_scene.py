"""From photographs to rankings through the processes of the whole service."""

import contextlib
import io
import os
import signal
import time
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import pytest
from PIL import Image
from plyfile import PlyData
from videos import textured, write_video

from fvs_engine.geometry.geodetic import GeodeticPosition, geodetic_from_enu
from fvs_engine.sfm.colmap.model import read_colmap

pytestmark = [
    pytest.mark.system,
    pytest.mark.timeout(900),  # several processes that all import torch, on whatever machine
]

RUNNER = "fvs_service.host.runner.process"
WORKER = "fvs_service.serving.process worker"
GATEWAY = "fvs_service.serving.process gateway"
SFM_CHILD = "fvs_engine.sfm.native.child"
ENDLESS = 100_000


def _latest(service: Any, scene: str) -> tuple[str, int]:
    """The scene's latest snapshot, and how many images are registered in it."""
    snapshot = service.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
    return snapshot, service.snapshot(snapshot)["metrics"]["registered"]


def _kill(service: Any, module: str) -> None:
    """Kill a process whose command line has ``module``, as soon as there is one."""
    deadline = time.monotonic() + 150
    while not (found := service.processes(module)):
        assert time.monotonic() < deadline
        time.sleep(0.02)
    os.kill(found[0], signal.SIGKILL)


def _niceness(pid: int) -> int:
    return os.getpriority(os.PRIO_PROCESS, pid)


def test_photographs_become_a_snapshot_that_ranks(service: Any, modelled: str) -> None:
    snapshot, quick = service.client.get(f"/v1/scenes/{modelled}/snapshots").json()["items"][-2:]
    assert quick["job_id"] == snapshot["job_id"]
    assert quick["metrics"]["iterations"] == 24
    assert quick["metrics"]["registered"] == snapshot["metrics"]["registered"] == 5
    names = {artifact["name"] for artifact in snapshot["artifacts"]}
    files = {"alignment.json", "cameras.json", "colmap.zip", "metrics.json"}
    assert names == {*files, "point_cloud.ply", "point_cloud.spz", "points.ply"}
    sizes = {artifact["name"]: artifact["size_bytes"] for artifact in snapshot["artifacts"]}
    assert sizes["point_cloud.spz"] < 0.3 * sizes["point_cloud.ply"]
    models = {}
    for made, how in ((quick, zipfile.ZIP_STORED), (snapshot, zipfile.ZIP_DEFLATED)):
        archive = service.client.get(f"/v1/snapshots/{made['id']}/artifacts/colmap.zip").content
        with zipfile.ZipFile(io.BytesIO(archive)) as model:
            assert {entry.compress_type for entry in model.infolist()} == {how}
            models[how] = {Path(name).name: model.read(name) for name in model.namelist()}
    assert models[zipfile.ZIP_STORED] == models[zipfile.ZIP_DEFLATED]
    assert models[zipfile.ZIP_STORED].keys() == {"cameras.bin", "images.bin", "points3D.bin"}
    points = service.client.get(f"/v1/snapshots/{snapshot['id']}/artifacts/points.ply").content
    assert len(PlyData.read(io.BytesIO(points))["vertex"]) == snapshot["metrics"]["points"] > 0
    ranking = service.rank(modelled, snapshot_id=snapshot["id"], rank_all=True)
    assert [place["rank"] for place in ranking["candidates"] if place["rank"]] == [1, 2, 3, 4]
    assert ranking["snapshot_id"] == snapshot["id"]
    assert ranking["iterations"] == snapshot["metrics"]["iterations"] == 120
    best = ranking["candidates"][0]["id"]
    for picture in ("render", "spectrum"):
        png = service.client.get(f"/v1/rankings/{ranking['id']}/candidates/{best}/{picture}.png")
        with Image.open(io.BytesIO(png.content)) as image:
            assert np.asarray(image).std() > 1


def test_every_method_ranks(service: Any, modelled: str) -> None:
    methods = service.client.get("/v1/capabilities").json()["methods"]
    pinned = service.client.get(f"/v1/scenes/{modelled}").json()["snapshot_id"]
    for method in methods:
        ranking = service.rank(modelled, method=method, snapshot_id=pinned, budget=3, rank_all=True)
        assert {place["id"] for place in ranking["candidates"]} == {f"orbit-{n:04d}" for n in range(4)}
        ranks = [place["rank"] for place in ranking["candidates"] if place["rank"]]
        assert ranks == list(range(1, len(ranks) + 1))
        assert ranking["request"]["method"] == method
        estimated = {place["estimated"] for place in ranking["candidates"]}
        assert estimated == {method == "median-frequency-estimate"}


def test_flights_are_planned_with_the_registered_points(service: Any, modelled: str) -> None:
    asked = {"generator": {"kind": "orbit", "count": 12}, "views": 3, "distance_m": 1e3, "home": True}
    answer = service.client.post(f"/v1/scenes/{modelled}/plans", json=asked)
    assert answer.status_code == 201, answer.text
    plan = answer.json()
    assert 1 <= len(plan["tours"][0]["stops"]) <= 3
    assert plan["end"]["variance"] < plan["now"]["variance"]
    chances = {term["id"]: term["chance"] for term in plan["candidates"]}
    assert all(0.0 <= chance <= 1.0 for chance in chances.values())
    assert max(chances.values()) > 0.5  # some of the ring was photographed
    ring = np.array([stop["pose"]["position"] for stop in plan["tours"][0]["stops"]])
    sides = (np.ptp(ring, axis=0) + 2.0).tolist()
    box = {"kind": "box", "centre": ring.mean(axis=0).tolist(), "size": sides}
    asked = {"generator": {"kind": "in-volume", "volume": box, "count": 50}, "safety_m": 0.01, "views": 2}
    inside = service.client.post(f"/v1/scenes/{modelled}/plans", json=asked)
    assert inside.status_code == 201, inside.text
    for stop in inside.json()["tours"][0]["stops"]:
        assert stop["id"].startswith("box-")
        offset = np.array(stop["pose"]["position"]) - box["centre"]
        assert (np.abs(offset) <= 0.5 * np.array(sides) + 1e-9).all()
    asked.pop("views")
    ranking = service.rank(modelled, **asked)
    assert 0 < ranking["total"] <= 50
    for place in ranking["candidates"]:
        offset = np.array(place["pose"]["position"]) - box["centre"]
        assert (np.abs(offset) <= 0.5 * np.array(sides) + 1e-9).all()
    assert ranking["candidates"][0]["rank"] == 1


def test_a_job_fails_the_next_is_stopped_and_retried_and_ends_with_its_scene(
    service: Any, courtyard_photographs: list[Path], tmp_path: Path
) -> None:
    """One scene and one runner for all of it: a runner takes seconds to start."""
    scene = service.scene()
    try:
        _fail(service, scene, tmp_path)
        service.send(scene, courtyard_photographs[4:])
        job = service.start(scene, iterations=ENDLESS)
        # Whoever looks too late to see the matching stops the mapping.
        for stages in (
            ("matching", "incremental-mapping", "global-mapping", "quick-training"),
            ("quick-training",),
        ):
            service.wait(job, lambda found, stages=stages: found["stage"] in stages)
            _stop_and_retry(service, job)
        found = service.wait(
            job, lambda found: found["stage"] == "quick-training" and found["eta_s"] is not None
        )
        assert found["attempt"] == 3
        runners = len(service.processes(RUNNER))
        assert service.client.get(f"/v1/scenes/{scene}/size").json()["images_bytes"] > 0
    finally:  # its job would keep the worker from those of other tests
        deleted = service.client.delete(f"/v1/scenes/{scene}")
    assert deleted.status_code == 204
    assert service.client.get(f"/v1/jobs/{job}").status_code == 404
    _until(lambda: len(service.processes(RUNNER)) == runners - 1)
    _until(lambda: _nothing_left(service.root, scene))


def _fail(service: Any, scene: str, folder: Path) -> None:
    """Let a job fail, on images of noise; it says why."""
    noise = []
    for number in range(3):
        pixels = np.random.default_rng(number).integers(0, 256, (96, 128, 3), dtype=np.uint8)
        noise.append(folder / f"{number}.png")
        Image.fromarray(pixels).save(noise[-1])
    service.send(scene, noise)
    job = service.start(scene, iterations=ENDLESS)
    failed = service.wait(job, lambda found: found["state"] == "failed")
    assert failed["error"]["code"] == "reconstruction-failed"
    assert failed["error"]["hint"]
    assert "0.png" in failed["error"]["message"]
    assert failed["error"]["stage"]
    refused = service.client.post(f"/v1/scenes/{scene}/rankings", json={"generator": {"kind": "orbit"}})
    assert refused.json()["code"] == "no-snapshot"


def _stop_and_retry(service: Any, job: str) -> None:
    """Cancel the job, which ends within two seconds, and start its next attempt."""
    asked = time.monotonic()
    service.client.post(f"/v1/jobs/{job}:cancel")
    deadline = asked + 30
    while service.job(job)["state"] != "canceled" and time.monotonic() < deadline:
        time.sleep(0.02)
    assert time.monotonic() - asked < 2.0
    again = service.client.post(f"/v1/jobs/{job}:retry")
    assert again.json()["state"] == "queued"


def _nothing_left(root: Path, scene: str) -> bool:
    """Whether no file of the scene is left. A walk that meets the removal itself is no answer yet."""
    try:
        return not list(root.glob(f"**/{scene}"))
    except FileNotFoundError:
        return False


def _until(holds: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120
    while not holds():
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_rankings_are_answered_while_the_model_learns(
    service: Any, modelled: str, courtyard_photographs: list[Path]
) -> None:
    before, registered = _latest(service, modelled)
    fine = service.start(modelled, "fine", iterations=ENDLESS)
    try:
        service.wait(fine, lambda found: found["stage"] == "training")
        assert service.rank(modelled)["snapshot_id"] == before
        (gateway,) = service.processes(GATEWAY)
        assert min(map(_niceness, service.processes(RUNNER))) > _niceness(gateway)
        # An update does not wait for a fine model, which goes on afterwards.
        service.send(modelled, courtyard_photographs[5:7])
        updated = service.finish(service.start(modelled))
        assert service.job(fine)["state"] == "running"
        assert _latest(service, modelled) == (updated["snapshot_id"], registered + 2)
        assert service.snapshot(before)["metrics"]["new_images_psnr_db"] is None
        assert 5 < service.snapshot(updated["snapshot_id"])["metrics"]["new_images_psnr_db"] < 40
    finally:  # it would keep the worker from the jobs of other tests
        service.client.post(f"/v1/jobs/{fine}:cancel")
    service.wait(fine, lambda found: found["state"] == "canceled")
    assert service.rank(modelled)["snapshot_id"] == updated["snapshot_id"]


def test_an_update_without_new_images_keeps_the_snapshot(service: Any, modelled: str) -> None:
    before = service.client.get(f"/v1/scenes/{modelled}").json()["snapshot_id"]
    made = service.snapshot(before)
    done = service.finish(service.start(modelled))
    scene = service.client.get(f"/v1/scenes/{modelled}").json()
    assert scene["snapshot_id"] == before
    if made["kind"] == "update":  # else there may be no snapshot of an update with the same model
        assert done["snapshot_id"] == before
        assert done["warnings"][-1]["code"] == "update-unchanged"
        assert done["warnings"][-1]["texts"] == {"snapshot": before}
    assert service.client.get(f"/v1/scenes/{modelled}/size").json()["working_bytes"] > 0


def test_an_update_ends_with_its_quick_model_when_the_next_one_waits(
    service: Any, courtyard_photographs: list[Path]
) -> None:
    scene = service.scene()
    service.send(scene, courtyard_photographs[:5])
    first = service.start(scene, iterations=2_000)
    service.wait(first, lambda found: found["stage"] == "training")
    service.send(scene, courtyard_photographs[5:6])
    second = service.start(scene)
    done = service.finish(first)
    snapshots = service.client.get(f"/v1/scenes/{scene}/snapshots").json()["items"]
    (quick,) = (item for item in snapshots if item["job_id"] == first)
    assert done["snapshot_id"] == quick["id"]
    assert quick["metrics"]["iterations"] == 400
    service.client.post(f"/v1/jobs/{second}:cancel")
    service.wait(second, lambda found: found["state"] == "canceled")


def test_a_quality_that_cannot_be_measured_is_a_warning(
    service: Any, courtyard_photographs: list[Path]
) -> None:
    scene = service.scene()
    service.send(scene, courtyard_photographs[:5])
    service.finish(service.start(scene, iterations=3, long_side_px=64))
    fine = service.start(scene, "fine", iterations=2, long_side_px=64, test_every=1_000)
    done = service.finish(fine)
    assert "none-held-out" in [warning["code"] for warning in done["warnings"]]
    made = service.client.get(f"/v1/snapshots/{done['snapshot_id']}").json()
    assert (made["metrics"]["iterations"], made["metrics"]["psnr_db"]) == (2, None)


@pytest.mark.slow  # half a minute; tests/faults kills more
def test_jobs_outlive_whatever_is_killed(
    service: Any, modelled: str, courtyard_photographs: list[Path]
) -> None:
    """The short form of ``tests/faults/kill_anything.py``."""
    _, registered = _latest(service, modelled)
    service.send(modelled, courtyard_photographs[7:])
    update = service.start(modelled)
    for module in (SFM_CHILD, RUNNER):
        _kill(service, module)
    done = service.finish(update)
    assert done["attempt"] == 1
    assert _latest(service, modelled) == (done["snapshot_id"], registered + 2)

    fine = service.start(modelled, "fine", iterations=300, test_every=4)
    service.wait(fine, lambda found: found["stage"] == "training")
    _kill(service, WORKER)
    assert service.rank(modelled)["snapshot_id"] == done["snapshot_id"]
    done = service.finish(fine)
    assert done["attempt"] == 1
    snapshots = service.client.get(f"/v1/scenes/{modelled}/snapshots").json()["items"]
    assert [item["job_id"] for item in snapshots].count(update) == 2  # the quick model and the full one
    (made,) = (item for item in snapshots if item["job_id"] == fine)
    assert (made["metrics"]["iterations"], made["metrics"]["sh_degree"]) == (300, 3)
    assert made["metrics"]["registered"] == registered + 2
    assert 10 < made["metrics"]["psnr_db"] < 40
    assert 0 < made["metrics"]["ssim"] < 1

    _kill(service, GATEWAY)
    deadline = time.monotonic() + 150
    while True:
        try:
            assert service.rank(modelled)["snapshot_id"] == made["id"]
            break
        except httpx2.TransportError:
            assert time.monotonic() < deadline
            time.sleep(0.1)


@pytest.mark.slow
def test_a_child_that_is_killed_every_time_fails_the_job_which_can_be_retried(
    service: Any, courtyard_photographs: list[Path]
) -> None:
    scene = service.scene()
    service.send(scene, courtyard_photographs[:5])
    job = service.start(scene)
    deadline = time.monotonic() + 240
    while (found := service.job(job))["state"] in ("queued", "running"):
        assert time.monotonic() < deadline
        for pid in service.processes(SFM_CHILD):
            with contextlib.suppress(ProcessLookupError):
                os.kill(pid, signal.SIGKILL)
    assert (found["state"], found["error"]["code"]) == ("failed", "runner-died")
    assert found["error"]["hint"]
    service.client.post(f"/v1/jobs/{job}:retry")
    assert service.finish(job)["attempt"] == 2


def test_frames_of_a_video_outlive_their_runner(service: Any, tmp_path: Path) -> None:
    """The runner that takes them is killed; no frame is missing then, and none is there twice."""
    scene = service.scene()
    frames = [(0.1 * n, textured(540, 960, seed=n)) for n in range(40)]
    service.send(scene, [write_video(tmp_path / "flight.mp4", frames)], every_s=0.1)
    job = service.client.get(f"/v1/scenes/{scene}/jobs").json()["items"][0]["id"]

    def images() -> list[dict[str, Any]]:
        return service.client.get(f"/v1/scenes/{scene}/images", params={"limit": 100}).json()["items"]

    _until(lambda: len(images()) > 2)
    for runner in service.processes(RUNNER):  # of which one is that of the scene
        os.kill(runner, signal.SIGKILL)
    service.finish(job)
    video, *taken = images()
    assert video["frames"] == len(taken) == len({image["name"] for image in taken}) == 40
    _until(lambda: not list(service.root.glob(f"scenes/{scene}/outcome/*")))


def test_control_points_align_the_next_update(service: Any, modelled: str, tmp_path: Path) -> None:
    """Marks of points in the scene's own cameras, surveyed ten times as far apart."""
    snapshot, _ = _latest(service, modelled)
    read = f"/v1/snapshots/{snapshot}/artifacts"
    with zipfile.ZipFile(io.BytesIO(service.client.get(f"{read}/colmap.zip").content)) as archive:
        archive.extractall(tmp_path)
    known = service.client.get(f"{read}/cameras.json").json()
    names = {view["image"].removeprefix("sha256:")[:12]: view["name"] for view in known["views"]}
    views = read_colmap(tmp_path / "sparse/0").views
    home = GeodeticPosition(47.5, 9.5, 400.0)
    draw, points = np.random.default_rng(0), []
    lower, upper = (np.array(known[corner]) for corner in ("lower", "upper"))
    while len(points) < 6:
        place = draw.uniform(lower, upper)
        marks = []
        for view in views:
            x, y = view.camera.project(view.camera_from_model.apply(place)).tolist()
            if 0 <= x <= view.camera.width and 0 <= y <= view.camera.height:
                name = names[view.name.partition("-")[2].partition(".")[0]]
                marks.append({"image": name, "x_px": x, "y_px": y})
        if len(marks) > 2:
            at = geodetic_from_enu(10.0 * place, home)
            where = {"x": at.longitude_deg, "y": at.latitude_deg, "z": at.altitude_m}
            points.append({"name": f"G{len(points)}", **where, "check": len(points) == 5, "marks": marks})
    path = f"/v1/scenes/{modelled}/control-points"
    body = {"crs": "EPSG:4326", "points": points}
    assert service.client.put(path, json=body).status_code == 200
    service.finish(service.start(modelled))
    aligned = service.snapshot(_latest(service, modelled)[0])
    assert aligned["alignment"]["source"] == "control-points"
    assert aligned["alignment"]["scale"] == pytest.approx(10.0, rel=0.01)
    assert aligned["control"]["check_rms_m"] < 0.1
    assert service.client.delete(path).status_code == 204
    service.finish(service.start(modelled))  # the scene of the other tests is in the model's frame again
