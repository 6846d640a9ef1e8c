import errno
import threading
from pathlib import Path
from typing import Any

import pytest
from alembic.autogenerate import compare_metadata
from alembic.migration import MigrationContext
from fvs_service.errors import NotFoundError, OutOfSpaceError
from fvs_service.ids import new_id
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import KNOWN_VERSIONS, Database
from fvs_service.storage.tables import Table
from sqlalchemy import text


@pytest.fixture
def blobs(tmp_path: Path) -> Blobs:
    return Blobs(tmp_path / "blobs")


def test_blobs_are_read_whole_and_in_parts(blobs: Blobs) -> None:
    content = bytes(range(256)) * 8192
    blobs.put(content, "a/b/c")
    assert blobs.info("a/b/c").size_bytes == len(content)
    assert blobs.read("a/b/c") == content
    assert b"".join(blobs.chunks("a/b/c", 1000, 1_500_000)) == content[1000:1_500_000]
    assert b"".join(blobs.chunks("a/b/c", 5, 5)) == b""


def test_a_file_is_moved_into_the_store(blobs: Blobs, tmp_path: Path) -> None:
    file = tmp_path / "upload"
    file.write_bytes(b"content")
    blobs.adopt(file, "images/x")
    assert not file.exists()
    assert blobs.read("images/x") == b"content"
    assert sorted(path.name for path in (tmp_path / "blobs").rglob("*")) == ["images", "x"]


def test_a_blob_is_placed_for_programs_that_need_files(blobs: Blobs, tmp_path: Path) -> None:
    blobs.put(b"content", "x")
    for _ in range(2):
        blobs.export("x", tmp_path / "work" / "x.jpg")
    assert (tmp_path / "work" / "x.jpg").read_bytes() == b"content"


def test_what_is_not_stored_is_not_found(blobs: Blobs, tmp_path: Path) -> None:
    assert not blobs.exists("nothing")
    with pytest.raises(NotFoundError):
        blobs.read("nothing")
    with pytest.raises(NotFoundError):
        blobs.export("nothing", tmp_path / "nothing")


def test_a_full_disk_leaves_no_part_of_a_blob(
    blobs: Blobs, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(_path: Path, content: bytes) -> int:
        raise OSError(errno.ENOSPC, f"no room for {len(content)} bytes")

    with monkeypatch.context() as patch:
        patch.setattr(Path, "write_bytes", full)
        with pytest.raises(OutOfSpaceError):
            blobs.put(b"content", "x")
    assert list((tmp_path / "blobs").iterdir()) == []


def test_migrations_make_the_tables_that_the_code_uses(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'test.sqlite3'}")
    database.migrate()
    database.migrate()
    with database.connect() as connection:
        context = MigrationContext.configure(connection)
        assert context.get_current_heads() == (KNOWN_VERSIONS[-1],)
        assert connection.execute(text("PRAGMA journal_mode")).scalar() == "wal"
        assert compare_metadata(context, Table.metadata) == []
    database.close()


def test_transactions_that_read_and_then_write_wait_for_each_other(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'test.sqlite3'}")
    with database.writing() as session:
        session.execute(text("CREATE TABLE counter (value INTEGER)"))
        session.execute(text("INSERT INTO counter VALUES (0)"))
    failures: list[Exception] = []

    def count() -> None:
        try:
            for _ in range(20):
                with database.writing() as session:
                    value = session.execute(text("SELECT value FROM counter")).scalar_one()
                    session.execute(text(f"UPDATE counter SET value = {value + 1}"))
        except Exception as error:
            failures.append(error)

    threads = [threading.Thread(target=count) for _ in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    with database.reading() as session:
        assert session.execute(text("SELECT value FROM counter")).scalar_one() == 80
    database.close()
    assert failures == []


def test_a_transaction_waits_for_the_disk_unless_it_need_not_be_durable(tmp_path: Path) -> None:
    database = Database(f"sqlite:///{tmp_path / 'test.sqlite3'}")
    modes = []
    for durable in (True, False, True):
        with database.writing(durable=durable) as session:
            modes.append(session.execute(text("PRAGMA synchronous")).scalar_one())
    database.close()
    full, normal = 2, 1  # SQLite's names of the levels
    assert modes == [full, normal, full]


def test_ids_sort_by_time_and_match_their_pattern() -> None:
    import re
    import time

    ids: list[Any] = []
    for _ in range(5):
        ids.append(new_id("scn"))
        time.sleep(0.002)
    assert ids == sorted(ids)
    assert all(re.fullmatch("scn_[0-9a-hjkmnp-tv-z]{26}", name) for name in ids)
