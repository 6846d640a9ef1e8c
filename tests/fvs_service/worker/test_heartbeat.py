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
    assert heartbeats.claim_dead("new") == ()
    _much_later(database)
    heartbeats.beat("new")
    assert heartbeats.claim_dead("old") == ()  # nobody takes itself, and the other lives
    assert heartbeats.claim_dead("new") == ("old",)
    assert heartbeats.claim_dead("new") == ()


def test_a_dead_worker_is_claimed_again_when_its_claimant_dies(database: Database) -> None:
    heartbeats = Heartbeats(database, lease_s=600)
    heartbeats.beat("old")
    _much_later(database)
    assert heartbeats.claim_dead("first") == ("old",)
    _much_later(database)
    assert heartbeats.claim_dead("second") == ("old",)
    heartbeats.forget("old")
    _much_later(database)
    assert heartbeats.claim_dead("second") == ()


def test_a_worker_that_was_taken_for_dead_learns_of_it(database: Database) -> None:
    heartbeats = Heartbeats(database, lease_s=600)
    assert not heartbeats.beat("old")
    assert heartbeats.beat("old")
    _much_later(database)
    assert heartbeats.claim_dead("new") == ("old",)
    heartbeats.forget("old")
    assert not heartbeats.beat("old")
