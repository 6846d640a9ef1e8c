import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from fvs_service.errors import ConflictError
from fvs_service.host.worker import heartbeat
from fvs_service.host.worker.heartbeat import Heartbeats, require_no_workers
from fvs_service.jobs.fleet import workers_of
from fvs_service.storage.database import Database


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = Database(f"sqlite:///{tmp_path / 'fvs.sqlite3'}")
    database.migrate()
    yield database
    database.close()


@pytest.fixture(autouse=True)
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(heartbeat, "_WATCH_S", 0.5)
    monkeypatch.setattr(heartbeat, "_LOOK_S", 0.01)


def test_a_heartbeat_renews_the_row_until_the_worker_ends(database: Database) -> None:
    worker = Heartbeats(database, "worker-0")
    worker.beat()
    worker.beat(slots=2, disk_full=True, backend="cpu", runner_bytes=7)
    with database.reading() as session:
        (status,) = workers_of(session)
    assert (status.id, status.alive, status.slots, status.disk_full) == ("worker-0", True, 2, True)
    assert (status.backend, status.runner_bytes) == ("cpu", 7)
    worker.end()
    with database.reading() as session:
        assert workers_of(session) == ()


def test_of_two_processes_that_are_one_worker_the_first_learns_that_it_is_none(database: Database) -> None:
    """As when a dispatcher wakes that was frozen, or two begin at once."""
    first, second = Heartbeats(database, "cluster"), Heartbeats(database, "cluster")
    assert first.beat()
    assert second.beat(slots=2)
    assert not first.beat()
    first.end()
    assert second.beat(slots=2)
    with database.reading() as session:
        (status,) = workers_of(session)
    assert status.slots == 2


def test_after_a_clean_stop_nobody_waits(database: Database) -> None:
    worker = Heartbeats(database, "worker-0")
    worker.beat()
    worker.end()
    began = time.monotonic()
    require_no_workers(database)
    assert time.monotonic() - began < 0.5


def test_a_worker_that_was_killed_a_moment_ago_is_none_of_another_service(database: Database) -> None:
    Heartbeats(database, "worker-0").beat()
    began = time.monotonic()
    require_no_workers(database)
    assert time.monotonic() - began >= 0.5


@pytest.mark.parametrize("others", ["worker-0", "worker-1"])
def test_a_heartbeat_of_another_service_is_noticed(others: str, database: Database) -> None:
    """Also that of a worker that was not there when the watch began."""
    Heartbeats(database, "worker-0").beat()
    beats = threading.Timer(0.1, Heartbeats(database, others).beat)
    beats.start()
    with pytest.raises(ConflictError, match="Another fvs serve runs workers"):
        require_no_workers(database)
    beats.join()
