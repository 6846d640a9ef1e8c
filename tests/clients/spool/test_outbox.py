import sqlite3
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from fvs_client.spool.errors import SpoolError, card_is_full
from fvs_client.spool.outbox import FILE_MISSING, FILE_NAME, Outbox
from fvs_client.spool.photograph import NewPhotograph, Refusal, State


@pytest.fixture
def outbox(tmp_path: Path) -> Iterator[Outbox]:
    with Outbox(tmp_path / FILE_NAME) as opened:
        yield opened


def _new(path: Path, digest: str = "aa", **changes: object) -> NewPhotograph:
    made = NewPhotograph(path, "scn_1", path.name, digest, size_bytes=1_000, mtime_ns=5)
    return replace(made, **changes)  # type: ignore[arg-type]


def test_photographs_keep_their_order(outbox: Outbox, tmp_path: Path) -> None:
    for number in (2, 1, 3):
        outbox.add(_new(tmp_path / f"{number}.jpg", digest=str(number)))
    assert [photograph.name for photograph in outbox.all()] == ["2.jpg", "1.jpg", "3.jpg"]
    oldest = outbox.next(newest_first=False)
    newest = outbox.next(newest_first=True)
    assert oldest is not None
    assert newest is not None
    assert (oldest.name, newest.name) == ("2.jpg", "3.jpg")
    outbox.acknowledge(oldest.number, "accepted")
    following = outbox.next(newest_first=False)
    assert following is not None
    assert following.name == "1.jpg"


def test_one_photograph_that_always_fails_does_not_hold_up_the_rest(outbox: Outbox, tmp_path: Path) -> None:
    first = outbox.add(_new(tmp_path / "1.jpg", digest="1"))
    second = outbox.add(_new(tmp_path / "2.jpg", digest="2"))
    tried = []
    for _ in range(40):
        found = outbox.next(newest_first=False)
        assert found is not None
        tried.append(found.number)
        outbox.set_back(found.number)
    assert set(tried) == {first.number, second.number}
    outbox.confirm(first.number, 500)
    now = outbox.next(newest_first=False)
    assert now is not None
    assert (now.number, now.setbacks) == (first.number, 0)


def test_adding_again_brings_metadata_up_to_date_until_they_are_sent(outbox: Outbox, tmp_path: Path) -> None:
    path = tmp_path / "1.jpg"
    outbox.add(_new(path))
    later = outbox.add(_new(path, metadata={"yaw_deg": 10.0}, sidecar="s"))
    assert (later.number, later.metadata) == (1, {"yaw_deg": 10.0})
    assert outbox.has(path, "scn_1", 1_000, 5, "s")
    assert not outbox.has(path, "scn_1", 1_000, 6, "s")
    assert not outbox.has(path, "scn_2", 1_000, 5, "s")
    outbox.begin(1, "upl_1")
    assert outbox.add(_new(path, metadata={"yaw_deg": 20.0})).metadata == {"yaw_deg": 10.0}
    other = outbox.add(_new(path, digest="bb"))
    assert other.number > 1


def test_a_refused_photograph_waits_again_only_when_asked_to(outbox: Outbox, tmp_path: Path) -> None:
    outbox.add(_new(tmp_path / "1.jpg"))
    outbox.refuse(1, Refusal("too-small", "It is too small.", "Send a larger one."), "too-small")
    assert outbox.next(newest_first=False) is None
    refused = outbox.get(1)
    assert (refused.state, refused.verdict) == (State.REFUSED, "too-small")
    assert refused.refusal == Refusal("too-small", "It is too small.", "Send a larger one.")
    outbox.retry(1)
    assert (outbox.get(1).state, outbox.get(1).refusal) == (State.WAITING, None)


def test_a_new_process_goes_on_where_the_last_one_ended(tmp_path: Path) -> None:
    with Outbox(tmp_path / FILE_NAME) as outbox:
        outbox.add(_new(tmp_path / "1.jpg"))
        outbox.begin(1, "upl_1")
        outbox.confirm(1, 700)
    with Outbox(tmp_path / FILE_NAME, create=False) as outbox:
        found = outbox.next(newest_first=False)
    assert found is not None
    assert (found.state, found.upload, found.offset_bytes) == (State.SENDING, "upl_1", 700)


def test_photographs_are_found_where_the_card_is_now(tmp_path: Path) -> None:
    (tmp_path / "here").mkdir()
    with Outbox(tmp_path / "here" / FILE_NAME) as outbox:
        outbox.add(_new(tmp_path / "here" / "1.jpg"))
        outbox.add(_new(tmp_path / "elsewhere" / "2.jpg"))
    (tmp_path / "here").rename(tmp_path / "there")
    with Outbox(tmp_path / "there" / FILE_NAME) as outbox:
        paths = [photograph.path for photograph in outbox.all()]
    assert paths == [tmp_path / "there" / "1.jpg", tmp_path / "elsewhere" / "2.jpg"]


def test_what_decides_about_files_is_on_the_disk_when_it_is_noted(outbox: Outbox, tmp_path: Path) -> None:
    """Acknowledgements must survive a power cut: files may be deleted after them. Offsets need not."""
    statements: list[str] = []
    outbox._database.set_trace_callback(statements.append)

    def commits() -> list[str]:
        """How durable the commits since the last call were: SQLite syncs each one only when FULL."""
        durable, found = "", []
        for statement in statements:
            if statement.startswith("PRAGMA synchronous"):
                durable = statement.rpartition(" ")[2]
            found += [durable] if statement == "COMMIT" else []
        statements.clear()
        return found

    added = outbox.add(_new(tmp_path / "1.jpg"))
    assert commits() == ["FULL"]
    outbox.confirm(1, 500)
    assert commits() == ["NORMAL"]
    outbox.acknowledge(1, "accepted")
    assert commits() == ["FULL"]
    outbox.set_deleted(added)
    assert commits() == ["FULL"]
    outbox.refuse(1, Refusal("too-small", "It is too small."))
    assert commits() == ["FULL"]
    assert outbox._database.execute("PRAGMA synchronous").fetchone() == (2,)


def test_names_that_are_no_text_are_kept(outbox: Outbox, tmp_path: Path) -> None:
    path = tmp_path / "\udcff.jpg"
    outbox.add(replace(_new(path), name="%FF.jpg"))
    assert outbox.get(1).path == path
    outbox.refuse(1, Refusal(FILE_MISSING, f"{path} is gone."))
    assert outbox.get(1).refusal == Refusal(FILE_MISSING, f"{tmp_path}/%FF.jpg is gone.")


def test_on_a_full_card_an_acknowledgement_is_still_noted(outbox: Outbox, tmp_path: Path) -> None:
    outbox.add(_new(tmp_path / "1.jpg"))
    (pages,) = outbox._database.execute("PRAGMA page_count").fetchone()
    outbox._database.execute(f"PRAGMA max_page_count = {pages}")
    outbox.acknowledge(1, "accepted")
    many = (_new(tmp_path / f"{number}.jpg", digest=f"{number:0200d}") for number in range(10_000))
    with pytest.raises(sqlite3.OperationalError) as caught:
        deque(map(outbox.add, many))
    assert card_is_full(caught.value)
    outbox.acknowledge(2, "accepted")
    assert [photograph.number for photograph in outbox.deletable()][:2] == [1, 2]


def test_what_is_no_outbox_is_left_alone(tmp_path: Path) -> None:
    with pytest.raises(SpoolError, match="There is no outbox"):
        Outbox(tmp_path / FILE_NAME, create=False)
    (tmp_path / FILE_NAME).write_bytes(b"no database" * 100)
    with pytest.raises(SpoolError, match="is damaged") as caught:
        Outbox(tmp_path / FILE_NAME)
    assert "away" in caught.value.hint
    assert (tmp_path / FILE_NAME).read_bytes() == b"no database" * 100


def test_an_outbox_of_a_newer_version_is_left_alone(tmp_path: Path) -> None:
    with Outbox(tmp_path / FILE_NAME) as outbox:
        outbox._database.execute("PRAGMA user_version = 99")
    with pytest.raises(SpoolError, match="newer"):
        Outbox(tmp_path / FILE_NAME)
