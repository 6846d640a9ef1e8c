import time
from collections.abc import Iterator
from pathlib import Path

import pytest
from fvs_service.storage.database import Database
from fvs_service.worker.presence import Presence


@pytest.fixture
def database(tmp_path: Path) -> Iterator[Database]:
    database = Database(f"sqlite:///{tmp_path / 'fvs.sqlite3'}")
    database.migrate()
    yield database
    database.close()


def test_a_worker_that_shows_itself_no_more_is_given_to_one_other(database: Database) -> None:
    presence = Presence(database, lease_s=0.02)
    presence.show("old")
    assert presence.take_dead("new") == ()
    time.sleep(0.1)
    presence.show("new")
    assert presence.take_dead("old") == ()  # nobody takes itself, and the other lives
    assert presence.take_dead("new") == ("old",)
    assert presence.take_dead("new") == ()
