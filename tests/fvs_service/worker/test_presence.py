from collections.abc import Iterator
from pathlib import Path

import pytest
from fvs_service.storage.database import Database
from fvs_service.storage.tables import WorkerRow
from fvs_service.worker.presence import Presence
from sqlalchemy import update


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = Database(f"sqlite:///{tmp_path / 'fvs.sqlite3'}")
    database.migrate()
    yield database
    database.close()


def _much_later(database: Database) -> None:
    """What was shown so far has run out, without a wait for it."""
    with database.writing() as session:
        session.execute(update(WorkerRow).values(expires_at_ms=0))


def test_a_worker_that_shows_itself_no_more_is_given_to_one_other(database: Database) -> None:
    presence = Presence(database, lease_s=600)
    presence.show("old")
    assert presence.take_dead("new") == ()
    _much_later(database)
    presence.show("new")
    assert presence.take_dead("old") == ()  # nobody takes itself, and the other lives
    assert presence.take_dead("new") == ("old",)
    assert presence.take_dead("new") == ()


def test_who_takes_over_dies_too_and_the_next_one_is_asked(database: Database) -> None:
    presence = Presence(database, lease_s=600)
    presence.show("old")
    _much_later(database)
    assert presence.take_dead("first") == ("old",)
    _much_later(database)
    assert presence.take_dead("second") == ("old",)
    presence.forget("old")
    _much_later(database)
    assert presence.take_dead("second") == ()


def test_a_worker_that_was_taken_for_dead_learns_of_it(database: Database) -> None:
    presence = Presence(database, lease_s=600)
    assert not presence.show("old")
    assert presence.show("old")
    _much_later(database)
    assert presence.take_dead("new") == ("old",)
    presence.forget("old")
    assert not presence.show("old")
