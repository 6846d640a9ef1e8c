"""Sweeps remove what was deleted; what cannot be removed now holds up nothing else."""

import concurrent.futures
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta
from itertools import pairwise
from typing import Any

import pytest
from fvs_service.application import Storage
from fvs_service.errors import StorageRefusedError, StorageUnavailableError
from fvs_service.host.worker.sweep import Sweeps
from fvs_service.settings import Retention
from fvs_service.storage import removals
from fvs_service.storage.removals import Removals
from fvs_service.storage.tables import EventRow
from sqlalchemy import func, select


def _broken() -> int:
    raise ZeroDivisionError


def _events(storage: Storage, scene: str) -> int:
    with storage.database.reading() as session:
        events = select(func.count()).select_from(EventRow).where(EventRow.scene_id == scene)
        return session.scalar(events) or 0


class Clock:
    now = 0.0

    def monotonic(self) -> float:
        return self.now


def _deny(monkeypatch: pytest.MonkeyPatch, blobs: Any, error: Exception, part: str = "") -> list[str]:
    """Let the store refuse to remove keys that contain ``part``; returns the keys that were asked for."""
    asked: list[str] = []
    remove = blobs.remove

    def refuse(key: str) -> None:
        asked.append(key)
        if part in key:
            raise error
        remove(key)

    monkeypatch.setattr(blobs, "remove", refuse)
    return asked


def _delete_images(gateway: Any, scene: str, contents: list[bytes]) -> list[str]:
    """Send and delete images; returns their keys."""
    digests = [gateway.put(scene, content).json()["digest"] for content in contents]
    for digest in digests:
        assert gateway.client.delete(f"/v1/scenes/{scene}/images/{digest}").status_code == 204
    return [
        f"scenes/{scene}/{kind}/{digest.removeprefix('sha256:')}"
        for digest in digests
        for kind in ("images", "thumbnails")
    ]


@pytest.mark.parametrize("error", [StorageRefusedError("No."), PermissionError("No.")])
def test_a_blob_that_cannot_be_removed_is_put_off_alone(
    open_gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch, error: Exception
) -> None:
    gateway = open_gateway()
    scene, storage = gateway.scene(), gateway.application.storage
    stays, *others = _delete_images(gateway, scene, [photograph(number) for number in range(3)])
    clock = Clock()
    monkeypatch.setattr(removals, "time", clock)
    asked = _deny(monkeypatch, storage.blobs, error, stays)
    assert storage.removals.run() == len(others)
    assert sorted(asked) == sorted([stays, *others])
    assert storage.removals.late(timedelta(0)) == (stays,)
    assert storage.removals.run() == 0
    assert asked.count(stays) == 1
    pauses = []
    while len(pauses) < 8:
        tries, clock.now = asked.count(stays), clock.now + 30.0
        storage.removals.run()
        if asked.count(stays) > tries:
            pauses.append(clock.now)
    assert [later - sooner for sooner, later in pairwise(pauses)] == [120, 240, 480, 960, 1920, 3600, 3600]
    monkeypatch.undo()
    Removals(storage.database, storage.blobs, 0).run()
    assert list(storage.blobs.below(f"scenes/{scene}/")) == []


def test_removals_wait_while_the_store_is_away(
    open_gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway()
    scene, storage = gateway.scene(), gateway.application.storage
    _delete_images(gateway, scene, [photograph(number) for number in range(3)])
    asked = _deny(monkeypatch, storage.blobs, StorageUnavailableError("Away."))
    storage.removals.run()
    assert len(asked) == 1  # each takes seconds
    storage.removals.run()
    assert len(set(asked)) == 2  # the oldest does not hold up the others


def test_other_writers_of_a_scene_wait_for_the_removal_of_one_blob_at_most(
    open_gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway()
    scene, storage = gateway.scene(), gateway.application.storage
    _delete_images(gateway, scene, [photograph(number) for number in range(3)])
    in_transaction: list[str] = []
    most, writing, remove = [0], storage.database.writing, storage.blobs.remove

    @contextmanager
    def watched(*arguments: Any, **options: Any) -> Iterator[Any]:
        with writing(*arguments, **options) as session:
            in_transaction.clear()
            yield session
        most[0] = max(most[0], len(in_transaction))

    monkeypatch.setattr(storage.database, "writing", watched)
    monkeypatch.setattr(storage.blobs, "remove", lambda key: (in_transaction.append(key), remove(key)))
    assert storage.removals.run() == 6
    assert most == [1]


def test_a_part_of_the_sweep_that_fails_does_not_stop_the_others(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway(retention=Retention(events=5))
    scene, storage = gateway.scene(), gateway.application.storage
    for number in range(10):
        gateway.client.patch(f"/v1/scenes/{scene}", json={"name": f"courtyard {number}"})
    before = _events(storage, scene)
    sweeps = Sweeps(storage)
    monkeypatch.setattr(storage.removals, "run", _broken)
    monkeypatch.setattr(sweeps._retention, "apply", _broken)
    monkeypatch.setattr(sweeps, "remove_working_folders", _broken)
    sweeps.sweep()
    assert _events(storage, scene) == 5 < before


def test_workers_remove_working_folders_of_deleted_scenes_only(gateway: Any) -> None:
    deleted, kept = gateway.scene(), gateway.scene()
    folders = {name: gateway.settings.scenes / name for name in (deleted, kept, "scn_of_another_database")}
    for folder in folders.values():
        (folder / "growing").mkdir(parents=True)
        (folder / "growing" / "state.json").write_text(json.dumps({}))
    gateway.client.delete(f"/v1/scenes/{deleted}")
    Sweeps(gateway.application.storage).remove_working_folders()
    assert {name for name, folder in folders.items() if folder.exists()} == set(folders) - {deleted}


def test_writes_that_a_crash_interrupted_are_swept(open_gateway: Any) -> None:
    gateway = open_gateway()
    old, new = (gateway.settings.root / "blobs" / f".{name}.partial" for name in ("old", "new"))
    for file in (old, new):
        file.write_bytes(b"half")
    os.utime(old, (1, 1))
    Sweeps(gateway.application.storage).sweep()
    assert (old.exists(), new.exists()) == (False, True)


def test_one_worker_at_a_time_sweeps(open_gateway: Any) -> None:
    storage = open_gateway(sweep_s=600).application.storage
    sweeps = [Sweeps(storage) for _ in range(4)]
    with concurrent.futures.ThreadPoolExecutor(4) as pool:
        assert sorted(pool.map(Sweeps._is_mine, sweeps)) == [False, False, False, True]
