from collections.abc import Iterator
from pathlib import Path

import pytest
from fvs_service.host.worker.heartbeat import Heartbeats
from fvs_service.storage.database import Database
from fvs_service.storage.tables import WorkerRow
from sqlalchemy import update


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = Database(f"sqlite:///{tmp_path / 'fvs.sqlite3'}")
    database.migrate()
    yield database
    database.close()


def _much_later(database: Database) -> None:
    """Expire all heartbeats."""
    with database.writing() as session:
        session.execute(update(WorkerRow).values(expires_at_ms=0))


class _Worker(Heartbeats):
    """A worker with a clock of its own, that has sent its first heartbeat."""

    def __init__(self, database: Database, worker_id: str) -> None:
        self.time_s = 0.0
        super().__init__(database, worker_id, lease_s=600, clock=lambda: self.time_s)
        self.beat()


def test_a_worker_without_heartbeats_is_claimed_by_one_other(database: Database) -> None:
    old, new = _Worker(database, "old"), _Worker(database, "new")
    assert new.beat().dead == ()
    _much_later(database)
    assert new.beat().dead == ("old",)
    assert new.beat().dead == ()
    _much_later(database)
    assert old.beat().dead == ("new",)  # nobody claims itself


def test_a_dead_worker_is_claimed_again_when_its_claimant_dies(database: Database) -> None:
    first, second = _Worker(database, "first"), _Worker(database, "second")
    _Worker(database, "old")
    second.beat()
    with database.writing() as session:
        session.execute(update(WorkerRow).where(WorkerRow.id == "old").values(expires_at_ms=0))
    assert first.beat().dead == ("old",)
    _much_later(database)
    assert set(second.beat().dead) == {"first", "old"}
    second.forget("first")
    second.forget("old")
    _much_later(database)
    assert second.beat().dead == ()


def test_a_worker_that_was_silent_itself_claims_nobody(database: Database) -> None:
    silent = _Worker(database, "silent")
    _Worker(database, "other")
    _much_later(database)
    silent.time_s += 3 * 600 + 1
    assert silent.beat().dead == ()  # the database may have been away, and the other is about to beat
    assert silent.beat().dead == ("other",)


def test_a_worker_that_was_taken_for_dead_learns_of_it(database: Database) -> None:
    old, new = Heartbeats(database, "old", lease_s=600), _Worker(database, "new")
    assert not old.beat().known
    assert old.beat().known
    _much_later(database)
    assert new.beat().dead == ("old",)
    new.forget("old")
    assert not old.beat().known
