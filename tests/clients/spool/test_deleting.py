"""What ``--delete-sent`` deletes, and what it must keep."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from fvs_client.spool import Settings, deleting, taking
from fvs_client.spool.folder import find_file
from fvs_client.spool.outbox import FILE_NAME, Outbox
from fvs_client.spool.photograph import Photograph, Refusal


@pytest.fixture
def outbox(tmp_path: Path) -> Iterator[Outbox]:
    with Outbox(tmp_path / FILE_NAME) as opened:
        yield opened


@pytest.fixture
def file(tmp_path: Path, photograph: Callable[..., bytes]) -> Path:
    made = tmp_path / "a.jpg"
    made.write_bytes(photograph(1))
    return made


def _take(outbox: Outbox, file: Path, scene: str = "scn_1") -> Photograph:
    return taking.take(outbox, find_file(file), scene)


def _make_room(outbox: Outbox, **settings: object) -> list[str]:
    said: list[str] = []
    made = Settings(delete_sent=True, **settings)  # type: ignore[arg-type]
    deleting.Room(outbox, made, said.append).make()
    return said


def test_only_what_the_service_has_accepted_is_deleted(outbox: Outbox, file: Path) -> None:
    number = _take(outbox, file).number
    _make_room(outbox)
    outbox.acknowledge(number, "duplicate")
    _make_room(outbox)
    assert file.exists()
    outbox.acknowledge(number, "accepted")
    _make_room(outbox)
    assert not file.exists()


def test_a_file_that_another_scene_lacks_stays(outbox: Outbox, file: Path) -> None:
    first = _take(outbox, file, "scn_1")
    outbox.acknowledge(first.number, "accepted")
    second = _take(outbox, file, "scn_2")
    assert outbox.kept_bytes() == file.stat().st_size
    _make_room(outbox)
    outbox.begin(second.number, "upl_1")
    _make_room(outbox)
    outbox.refuse(second.number, Refusal("not-found", "There is no such scene."))
    _make_room(outbox)
    assert file.exists()
    outbox.acknowledge(second.number, "duplicate")  # of an image whose bytes the scene has
    _make_room(outbox)
    assert not file.exists()
    assert all(photograph.deleted for photograph in outbox.all())
    assert outbox.kept_bytes() == 0


def test_files_are_counted_once_and_with_their_newest_content(
    outbox: Outbox, file: Path, photograph: Callable[..., bytes]
) -> None:
    for seed, size in ((1, (96, 64)), (2, (200, 100))):
        file.write_bytes(photograph(seed, size=size))
        for scene in ("scn_1", "scn_2"):
            outbox.acknowledge(_take(outbox, file, scene).number, "accepted")
    size_bytes = file.stat().st_size
    assert outbox.kept_bytes() == size_bytes
    assert _make_room(outbox, max_disk_bytes=size_bytes) == []
    assert file.exists()
    _make_room(outbox, max_disk_bytes=size_bytes - 1)
    assert not file.exists()


def test_a_file_that_is_written_to_while_it_is_read_stays(
    outbox: Outbox, file: Path, photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    outbox.acknowledge(_take(outbox, file).number, "accepted")
    newer = photograph(2)

    def digest_of(path: Path) -> str:
        digest = taking.digest_of(path)
        path.write_bytes(newer)
        return digest

    monkeypatch.setattr(deleting, "digest_of", digest_of)
    _make_room(outbox)
    assert file.read_bytes() == newer
    assert not outbox.get(1).deleted
    monkeypatch.undo()
    _make_room(outbox)
    assert file.read_bytes() == newer
    assert outbox.get(1).deleted


def test_many_files_are_deleted_the_oldest_first(outbox: Outbox, tmp_path: Path) -> None:
    for number in range(230):
        made = tmp_path / f"{number:03d}.jpg"
        made.write_bytes(b"%03d" % number)
        outbox.acknowledge(_take(outbox, made).number, "accepted")
    _make_room(outbox, max_disk_bytes=3 * 5)
    assert sorted(path.name for path in tmp_path.glob("*.jpg")) == [
        f"{number}.jpg" for number in range(225, 230)
    ]


def test_a_file_that_cannot_be_deleted_is_said_once_and_read_once_a_minute(
    outbox: Outbox, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now, said, reads = 0.0, list[str](), list[Path]()

    def read_only(path: Path) -> None:
        raise OSError(30, "Read-only file system", str(path))

    def digest_of(path: Path) -> str:
        reads.append(path)
        return taking.digest_of(path)

    monkeypatch.setattr(Path, "unlink", read_only)
    monkeypatch.setattr(deleting, "digest_of", digest_of)
    outbox.acknowledge(_take(outbox, file).number, "accepted")
    room = deleting.Room(outbox, Settings(delete_sent=True), said.append, clock=lambda: now)
    for now in range(0, 121):  # noqa: B007 -- the clock reads it
        room.make()
    assert (len(said), len(reads)) == (1, 3)
    monkeypatch.undo()
    now = 200
    room.make()
    assert not file.exists()
    assert outbox.get(1).deleted
