"""The file that shows a probe on its machine that a worker's heartbeats arrive."""

import os
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fvs_service.application import open_storage
from fvs_service.errors import StorageUnavailableError
from fvs_service.host.worker.heartbeat import Heartbeats, forget_heartbeats, touch_heartbeat
from fvs_service.host.worker.process import _maintain, _ReplacedError
from fvs_service.settings import Settings

LONG_AGO = (1, 1)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The file of a worker whose last heartbeat was long ago."""
    file = Settings(root=tmp_path).heartbeats / "worker-0"
    touch_heartbeat(file)
    os.utime(file, LONG_AGO)
    return file


def _beat(file: Path, before: Callable[[Heartbeats], object]) -> None:
    room: Any = SimpleNamespace(short=False)
    scenes: Any = SimpleNamespace(backend="cpu", resident_bytes=0)
    with open_storage(Settings(root=file.parent.parent)) as storage:
        heartbeats = Heartbeats(storage.database, "worker-0", 600)
        before(heartbeats)
        _maintain(storage, heartbeats, room, scenes, file)


def test_a_heartbeat_renews_the_file(file: Path) -> None:
    _beat(file, Heartbeats.beat)
    assert file.stat().st_mtime > 1


def test_a_heartbeat_that_does_not_arrive_leaves_the_file(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def away(*_: object, **_state: object) -> None:
        raise StorageUnavailableError("The database cannot be reached.")

    monkeypatch.setattr(Heartbeats, "beat", away)
    _beat(file, lambda _: None)
    assert file.stat().st_mtime == 1


def test_the_heartbeat_of_a_replaced_worker_leaves_the_file(file: Path) -> None:
    with pytest.raises(_ReplacedError):
        _beat(file, lambda _: None)  # the database does not know it
    assert file.stat().st_mtime == 1


def test_files_of_earlier_workers_are_deleted(file: Path) -> None:
    forget_heartbeats(file.parent)
    assert not file.exists()
    file.parent.rmdir()
    forget_heartbeats(file.parent)


def test_a_folder_that_cannot_be_made_is_no_error(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    touch_heartbeat(tmp_path / "file" / "worker-0")
