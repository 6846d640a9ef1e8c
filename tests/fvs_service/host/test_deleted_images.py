"""A deleted photograph leaves the folders of its scene on every worker, whether an update follows or not."""

import os
import shutil
import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest
from fvs_service.deletion.event_retention import EventRetention
from fvs_service.host.worker.deleted_images import DeletedImages
from fvs_service.host.worker.leased_scenes import LeasedScenes
from fvs_service.host.worker.sweep import Sweeps
from fvs_service.images.files import file_name
from fvs_service.settings import Retention
from sqlalchemy import event

from fvs_engine.files.lock import locked_folder
from fvs_schema.images import Image

RUNNER = "fvs_service.host.runner.process"


@pytest.fixture
def scenes(gateway: Any) -> Any:
    """The scenes of a worker that runs none."""
    leased = LeasedScenes(gateway.application.storage, "worker-0")
    yield leased
    leased.stop()


def folder_with_copies(gateway: Any, scene: str, *more: str) -> Path:
    """The scene's folder with a copy of each of its images, and others."""
    folder = gateway.settings.scenes / scene
    for part in ("images", "arrivals", "ready"):
        (folder / part).mkdir(parents=True)
    for item in gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"]:
        name = file_name(Image.model_validate({**item, "scene_id": scene}))
        (folder / "images" / name).write_bytes(b"pixels")
    for name in more:
        (folder / name).write_bytes(b"pixels")
    return folder


def left(folder: Path) -> list[str]:
    return sorted(file.relative_to(folder).as_posix() for file in folder.glob("*/*"))


def delete(gateway: Any, scene: str, number: int) -> None:
    items = gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"]
    (digest,) = (item["digest"] for item in items if item["number"] == number)
    assert gateway.client.delete(f"/v1/scenes/{scene}/images/{digest}").status_code == 204


def test_copies_of_deleted_images_go_and_those_of_others_stay(
    gateway: Any, scenes: LeasedScenes, photograph: Any
) -> None:
    scene, other = gateway.scene(), gateway.scene()
    for seed in range(3):
        gateway.put(scene, photograph(seed))
        gateway.put(other, photograph(seed))
    names = "arrivals/000001-left-by-a-kill.jpg", "ready/000001-left-by-a-kill.png"
    folder, others = folder_with_copies(gateway, scene, *names), folder_with_copies(gateway, other)
    before = left(others)
    (folder / "masks").mkdir()
    for image in list((folder / "images").iterdir())[:3]:
        (folder / "masks" / f"{image.name}.png").write_bytes(b"a mask")
    sweep = DeletedImages(gateway.application.storage, scenes.without_jobs)
    sweep.remove()
    images = ["images/000001", "images/000002", "images/000003"]
    masks = ["masks/000001-", "masks/000002-", "masks/000003-"]
    assert [name[:13] for name in left(folder)] == images + masks
    delete(gateway, scene, 2)
    sweep.remove()
    assert [name[:13] for name in left(folder)] == images[::2] + masks[::2]
    assert left(others) == before


def test_a_worker_that_was_away_looks_once(gateway: Any, scenes: LeasedScenes, photograph: Any) -> None:
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    folder = folder_with_copies(gateway, scene)
    delete(gateway, scene, 1)
    Sweeps(gateway.application.storage, scenes.without_jobs).sweep()
    assert left(folder) == []


def test_a_folder_in_use_is_left_until_it_is_free(
    gateway: Any, scenes: LeasedScenes, photograph: Any
) -> None:
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    folder = folder_with_copies(gateway, scene)
    delete(gateway, scene, 1)
    sweep = DeletedImages(gateway.application.storage, scenes.without_jobs)
    with locked_folder(folder):
        sweep.remove()
        assert len(left(folder)) == 1
    sweep.remove()
    assert left(folder) == []


def test_a_deletion_whose_event_the_retention_took_is_seen(open_gateway: Any, photograph: Any) -> None:
    gateway = open_gateway()
    storage = gateway.application.storage
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    folder = folder_with_copies(gateway, scene)
    leased = LeasedScenes(storage, "worker-0")
    try:
        sweep = DeletedImages(storage, leased.without_jobs)
        sweep.remove()
        delete(gateway, scene, 1)
        gateway.client.patch(f"/v1/scenes/{scene}", json={"name": "renamed"})
        assert EventRetention(storage.database, Retention(events=1)).apply()
        sweep.remove()
    finally:
        leased.stop()
    assert left(folder) == []


def test_a_folder_of_an_unknown_scene_is_left_to_the_doctor(gateway: Any, scenes: LeasedScenes) -> None:
    folder = gateway.settings.scenes / "scn_of_a_restored_backup"
    (folder / "images").mkdir(parents=True)
    (folder / "images" / "000001-abcdefabcdef.jpg").write_bytes(b"pixels")
    DeletedImages(gateway.application.storage, scenes.without_jobs).remove()
    assert len(left(folder)) == 1


def test_a_scene_that_has_lost_nothing_keeps_its_images_in_memory(gateway: Any, photograph: Any) -> None:
    """The first sweep of a worker looks at every scene that it has."""
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    folder = folder_with_copies(gateway, scene)
    asked: list[str] = []

    @contextmanager
    def without_jobs(asked_for: Path) -> Iterator[bool]:
        asked.append(asked_for.name)
        yield False

    sweep = DeletedImages(gateway.application.storage, without_jobs)
    sweep.remove()
    assert scene not in asked
    delete(gateway, scene, 1)
    sweep.remove()
    assert scene in asked
    shutil.rmtree(folder)


def test_nothing_but_the_last_event_is_read_while_nothing_is_deleted(
    gateway: Any, scenes: LeasedScenes, photograph: Any
) -> None:
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    folder_with_copies(gateway, scene)
    storage = gateway.application.storage
    sweep = DeletedImages(storage, scenes.without_jobs)
    sweep.remove()
    seen, here = [], threading.current_thread()

    def note(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if threading.current_thread() is here:  # the gateway looks for events
            seen.append(statement)

    event.listen(storage.database._engine, "before_cursor_execute", note)
    try:
        sweep.remove()
    finally:
        event.remove(storage.database._engine, "before_cursor_execute", note)
    assert [said for said in seen if said.startswith("SELECT")] == [
        "SELECT max(events.number) AS max_1 \nFROM events"
    ]


@pytest.mark.system
def test_deleted_photographs_go_while_their_scene_is_loaded_and_the_next_update_works(
    serving: Callable[..., Any], tmp_path: Path, courtyard_photographs: list[Path]
) -> None:
    with serving(tmp_path / "root", {}) as service:
        scene = service.scene()
        service.send(scene, courtyard_photographs[:7])
        service.finish(service.start(scene))
        images = tmp_path / "root" / "scenes" / scene / "images"
        assert len(list(images.iterdir())) == 7
        (runner,) = service.processes(RUNNER)

        _delete(service, scene, 3)
        _until_gone(images, "000003-")
        assert service.processes(RUNNER) == [runner]
        assert service.rank(scene)["candidates"]

        os.kill(runner, signal.SIGKILL)
        _delete(service, scene, 5)
        _until_gone(images, "000005-")
        service.send(scene, courtyard_photographs[7:8])
        service.finish(service.start(scene))
        assert sorted(file.name[:6] for file in images.iterdir()) == [
            f"{number:06d}" for number in (1, 2, 4, 6, 7, 8)
        ]
        snapshot = service.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
        assert service.snapshot(snapshot)["metrics"]["registered"] == 6


def _delete(service: Any, scene: str, number: int) -> None:
    items = service.client.get(f"/v1/scenes/{scene}/images").json()["items"]
    (digest,) = (item["digest"] for item in items if item["number"] == number)
    assert service.client.delete(f"/v1/scenes/{scene}/images/{digest}").status_code == 204


def _until_gone(folder: Path, beginning: str) -> None:
    deadline = time.monotonic() + 60
    while any(file.name.startswith(beginning) for file in folder.iterdir()):
        assert time.monotonic() < deadline
        time.sleep(0.1)


def test_a_folder_that_cannot_be_cleaned_holds_up_no_other(
    gateway: Any, scenes: LeasedScenes, photograph: Any
) -> None:
    both = sorted((gateway.scene(), gateway.scene()))
    for scene in both:
        gateway.put(scene, photograph(1))
    first, second = (folder_with_copies(gateway, scene) for scene in both)
    (first / "images" / "no-file").mkdir()
    for scene in both:
        delete(gateway, scene, 1)
    sweep = DeletedImages(gateway.application.storage, scenes.without_jobs)
    sweep.remove()
    assert "images/no-file" in left(first)
    assert left(second) == []
    (first / "images" / "no-file").rmdir()
    sweep.remove()
    assert left(first) == []
