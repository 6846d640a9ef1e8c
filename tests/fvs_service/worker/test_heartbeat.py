from collections.abc import Iterator
from pathlib import Path

import pytest
from fvs_service.storage.database import Database
from fvs_service.storage.tables import WorkerRow
from fvs_service.worker.heartbeat import Heartbeats
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


def test_a_worker_without_heartbeats_is_claimed_by_one_other(database: Database) -> None:
    heartbeats = Heartbeats(database, lease_s=600)
    heartbeats.beat("old")
    assert heartbeats.beat("new").dead == ()
    _much_later(database)
    assert heartbeats.beat("new").dead == ("old",)
    assert heartbeats.beat("new").dead == ()
    _much_later(database)
    assert heartbeats.beat("old").dead == ("new",)  # nobody claims itself


def test_a_dead_worker_is_claimed_again_when_its_claimant_dies(database: Database) -> None:
    heartbeats = Heartbeats(database, lease_s=600)
    heartbeats.beat("old")
    _much_later(database)
    assert heartbeats.beat("first").dead == ("old",)
    _much_later(database)
    assert set(heartbeats.beat("second").dead) == {"first", "old"}
    heartbeats.forget("first")
    heartbeats.forget("old")
    _much_later(database)
    assert heartbeats.beat("second").dead == ()


def test_a_worker_that_was_taken_for_dead_learns_of_it(database: Database) -> None:
    heartbeats = Heartbeats(database, lease_s=600)
    assert not heartbeats.beat("old").known
    assert heartbeats.beat("old").known
    _much_later(database)
    assert heartbeats.beat("new").dead == ("old",)
    heartbeats.forget("old")
    assert not heartbeats.beat("old").known
