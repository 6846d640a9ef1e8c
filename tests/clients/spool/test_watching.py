import os
import time
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fvs_client import ImageMetadata
from fvs_client.spool import watching as watching_module
from fvs_client.spool.outbox import FILE_MISSING, FILE_NAME, Outbox
from fvs_client.spool.photograph import Refusal, State
from fvs_client.spool.watching import Watcher


class Watching:
    """A watcher whose time is the test's."""

    def __init__(
        self, folder: Path, outbox: Outbox, describe: Callable[[Path], ImageMetadata | None] | None
    ) -> None:
        self.folder, self.outbox = folder, outbox
        self.now = 0.0
        self.said: list[str] = []
        self._watcher = Watcher(
            folder,
            "scn_1",
            outbox,
            settle_s=2.0,
            say=self.said.append,
            describe=describe,
            clock=lambda: self.now,
        )

    def look(self, after_s: float = 1.0) -> list[str]:
        self.now += after_s
        return [photograph.name for photograph in self._watcher.look()]

    @property
    def rest_s(self) -> float:
        return self._watcher.rest_s


@pytest.fixture
def watching(tmp_path: Path) -> Iterator[Callable[..., Watching]]:
    folder = tmp_path / "DCIM"
    folder.mkdir()
    with Outbox(folder / FILE_NAME) as outbox:
        yield lambda describe=None: Watching(folder, outbox, describe)


def test_a_file_is_taken_when_it_is_whole_and_has_settled(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    content = photograph(1, size=(300, 300))
    file = watched.folder / "DJI_0001.JPG"
    written = 0
    while written < len(content):
        written += len(content) // 4
        file.write_bytes(content[:written])
        assert watched.look() == []
    assert watched.look() == []
    assert watched.look() == ["DJI_0001.JPG"]
    assert watched.look() == []
    assert watched.outbox.get(1).size_bytes == len(content)


@pytest.mark.parametrize("begun", [slice(0, 0), slice(0, 10), slice(0, -1)])
def test_a_file_that_stays_without_its_end_is_refused_until_it_is_whole(
    watching: Callable[..., Watching], photograph: Callable[..., bytes], begun: slice
) -> None:
    watched = watching()
    content = photograph(1)
    file = watched.folder / "a.jpg"
    file.write_bytes(content[begun])
    for _ in range(3):
        assert watched.look(29) == []
    assert watched.said == []
    assert watched.look(3) == ["a.jpg"]
    assert watched.look(60) == []
    cut = watched.outbox.get(1)
    assert cut.state is State.REFUSED
    assert cut.refusal is not None
    assert watched.said == [f"a.jpg is not sent. {cut.refusal.reason} {cut.refusal.hint}"]
    assert "has no end" in cut.refusal.reason
    assert watching().look(120) == []  # it is known
    assert file.read_bytes() == content[begun]
    file.write_bytes(content)
    watched.look()
    assert watched.look(2) == ["a.jpg"]
    assert [(found.name, found.state) for found in watched.outbox.all()] == [("a.jpg", State.WAITING)]


def test_a_file_without_its_end_is_sent_as_it_is_on_request(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    (watched.folder / "a.jpg").write_bytes(photograph(1)[:-1])
    watched.look()
    watched.look(60)
    watched.outbox.retry(1)
    assert watched.look(60) == []
    assert watched.outbox.get(1).state is State.WAITING


def test_order_is_that_of_the_numbers_whatever_the_clock_says(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    for number, year_s in ((10_000, 0), (2, 1_700_000_000), (10, 86_400)):
        file = watched.folder / f"DJI_{number}.jpg"
        file.write_bytes(photograph(number))
        os.utime(file, (year_s, year_s))
    watched.look()
    assert watched.look(2) == ["DJI_2.jpg", "DJI_10.jpg", "DJI_10000.jpg"]
    later = watched.folder / "DJI_1.jpg"
    later.write_bytes(photograph(1))
    os.utime(later, (0, 0))
    watched.look()
    watched.look(2)
    assert [photograph.name for photograph in watched.outbox.all()][-1] == "DJI_1.jpg"


def test_a_known_file_is_not_read_again(
    watching: Callable[..., Watching], photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    watched = watching()
    (watched.folder / "a.jpg").write_bytes(photograph(1))
    watched.look()
    assert watched.look(2) == ["a.jpg"]
    again = watching()
    monkeypatch.setattr("fvs_client.spool.watching.is_whole", None)
    monkeypatch.setattr("fvs_client.spool.watching.take", None)
    again.look()
    assert again.look(2) == []


def test_a_file_with_other_content_is_another_photograph(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    for seed in (1, 2):
        (watched.folder / "a.jpg").write_bytes(photograph(seed))
        watched.look()
        assert watched.look(2) == ["a.jpg"]
    assert len({photograph.digest for photograph in watched.outbox.all()}) == 2


def test_metadata_come_from_the_sidecar_and_the_callback(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching(lambda path: ImageMetadata(yaw_deg=20.0) if path.stem == "a" else None)
    (watched.folder / "a.jpg").write_bytes(photograph(1))
    (watched.folder / "a.json").write_text(
        '{"pitch_deg": -30, "yaw_deg": 10, "captured_at": "2026-05-01T12:00:00Z"}'
    )
    (watched.folder / "b.jpg").write_bytes(photograph(2))
    (watched.folder / "b.jpg.json").write_text('{"name": "left", "x_m": 1, "y_m": 2, "z_m": 3}')
    (watched.folder / "c.jpg").write_bytes(photograph(3))
    watched.look()
    watched.look(2)
    first, second, third = watched.outbox.all()
    assert first.metadata == {"pitch_deg": -30.0, "yaw_deg": 20.0, "captured_at": "2026-05-01T12:00:00Z"}
    assert (second.name, second.metadata) == ("left", {"x_m": 1.0, "y_m": 2.0, "z_m": 3.0})
    assert third.metadata == {}


def test_a_sidecar_may_come_later_than_its_photograph(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    (watched.folder / "a.jpg").write_bytes(photograph(1))
    watched.look()
    watched.look(2)
    (watched.folder / "a.json").write_text('{"yaw_deg": 10}')
    watched.look()
    watched.look(2)
    assert [found.metadata for found in watched.outbox.all()] == [{"yaw_deg": 10.0}]


@pytest.mark.parametrize(
    ("sidecar", "reason"),
    [
        ("{", "not JSON"),
        ('{"heading": 1}', "heading"),
        ('{"yaw_deg": "north"}', "yaw_deg"),
        ("[]", "a JSON object"),
    ],
)
def test_a_sidecar_that_cannot_be_used_keeps_the_photograph_until_it_is_corrected(
    watching: Callable[..., Watching], photograph: Callable[..., bytes], sidecar: str, reason: str
) -> None:
    watched = watching()
    (watched.folder / "a.jpg").write_bytes(photograph(1))
    (watched.folder / "a.json").write_text(sidecar)
    watched.look()
    watched.look(2)
    found = watched.outbox.get(1)
    assert found.state is State.REFUSED
    assert found.refusal is not None
    assert reason in found.refusal.reason
    assert "Correct" in watched.said[0]
    (watched.folder / "a.json").write_text('{"yaw_deg": 10}')
    watched.look()
    watched.look(2)
    assert (watched.outbox.get(1).state, watched.outbox.get(1).metadata) == (State.WAITING, {"yaw_deg": 10.0})


def test_what_the_service_does_not_read_is_said_and_not_sent(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    (watched.folder / "a.JPG").write_bytes(photograph(1))
    (watched.folder / "a.dng").write_bytes(b"raw" * 9)
    (watched.folder / "b.heic").write_bytes(b"heic" * 9)
    (watched.folder / "notes.txt").write_text("no photograph")
    (watched.folder / ".hidden.jpg").write_bytes(photograph(2))
    watched.look()
    watched.look(2)
    assert {found.name: found.state for found in watched.outbox.all()} == {
        "a.JPG": State.WAITING,
        "b.heic": State.REFUSED,
    }


def test_a_file_that_comes_back_waits_again(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    (watched.folder / "a.jpg").write_bytes(photograph(1))
    watched.look()
    watched.look(2)
    watched.outbox.refuse(1, Refusal(FILE_MISSING, "It is gone."))
    away = watched.folder.with_name("a.jpg")
    (watched.folder / "a.jpg").rename(away)
    watched.look()
    away.rename(watched.folder / "a.jpg")
    watched.look()
    assert watched.look(2) == ["a.jpg"]
    assert (watched.outbox.get(1).state, watched.outbox.get(1).refusal) == (State.WAITING, None)


def test_a_card_that_is_taken_out_is_waited_for(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    away = watched.folder.with_name("away")
    watched.folder.rename(away)
    assert watched.look() == []
    assert watched.look() == []
    assert len(watched.said) == 1
    away.rename(watched.folder)
    (watched.folder / "100MEDIA").mkdir()
    (watched.folder / "100MEDIA" / "a.jpg").write_bytes(photograph(1))
    watched.look()
    assert watched.look(2) == ["100MEDIA_a.jpg"]


def test_what_cannot_be_read_holds_up_nothing_else_and_is_said_once(
    watching: Callable[..., Watching], photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Not by permissions: root has all of them."""
    watched = watching()
    for number, name in enumerate(("a.jpg", "b.jpg", "c.jpg", "lost+found/d.jpg")):
        (watched.folder / name).parent.mkdir(exist_ok=True)
        (watched.folder / name).write_bytes(photograph(number))
    listed, whole, broken = os.scandir, watching_module.is_whole, True

    def scandir(folder: Path | str) -> Any:
        if broken and str(folder).endswith("lost+found"):
            raise PermissionError(13, "Permission denied", str(folder))
        return listed(folder)

    def is_whole(path: Path) -> bool:
        if broken and path.name in {"a.jpg", "b.jpg"}:
            raise PermissionError(13, "Permission denied", str(path))
        return whole(path)

    monkeypatch.setattr(os, "scandir", scandir)
    monkeypatch.setattr(watching_module, "is_whole", is_whole)
    assert [name for _ in range(5) for name in watched.look()] == ["c.jpg"]
    assert len(watched.said) == 3, watched.said
    broken = False
    assert sorted(name for _ in range(4) for name in watched.look()) == ["a.jpg", "b.jpg", "lost+found_d.jpg"]


def test_the_wall_clock_is_not_asked_when_a_file_is_complete(
    watching: Callable[..., Watching], photograph: Callable[..., bytes]
) -> None:
    watched = watching()
    for name, days in (("past.jpg", -9000), ("future.jpg", 9000)):
        (watched.folder / name).write_bytes(photograph(days + 9001))
        os.utime(watched.folder / name, (time.time() + days * 86_400,) * 2)
    assert watched.look() == []
    assert sorted(name for _ in range(3) for name in watched.look()) == ["future.jpg", "past.jpg"]


def test_many_files_are_taken_in_their_order_and_none_holds_up_the_others(
    watching: Callable[..., Watching], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching_module, "_MOST_PER_LOOK", 4)
    watched = watching()
    whole, half = b"\xff\xd8\xff\xfe\x00\x02" + b"z" * 20 + b"\xff\xd9", b"\xff\xd8" + b"z" * 30
    for number in range(20):
        content = half if number < 7 else whole + b"%d" % number
        (watched.folder / f"DJI_{number}.jpg").write_bytes(content)
    taken = [name for _ in range(12) for name in watched.look(2)]
    assert taken == [f"DJI_{number}.jpg" for number in range(7, 20)]
    for number in (0, 6):
        (watched.folder / f"DJI_{number}.jpg").write_bytes(whole + b"%d" % number)
    assert [name for _ in range(2) for name in watched.look(2)] == ["DJI_0.jpg", "DJI_6.jpg"]
    # The others are still tried in turn, although they do not change.
    monkeypatch.setattr(watching_module, "is_whole", lambda _: True)
    later = [name for _ in range(2) for name in watched.look(2)]
    assert sorted(later) == [f"DJI_{number}.jpg" for number in range(1, 6)]


def test_a_spool_that_starts_again_looks_again_at_once(
    watching: Callable[..., Watching], photograph: Callable[..., bytes], monkeypatch: pytest.MonkeyPatch
) -> None:
    """The first scan asks the outbox about every file, so its duration says nothing about later ones."""
    watched = watching()
    for number in range(3):
        (watched.folder / f"{number}.jpg").write_bytes(photograph(number))
    watched.look()
    assert len(watched.look(2)) == 3
    again, asked = watching(), []

    def has(*file: Any) -> bool:
        asked.append(file)
        again.now += 1.0
        return True

    monkeypatch.setattr(again.outbox, "has", has)
    assert again.look() == []
    assert again.rest_s == 0.0
    assert again.look() == []
    assert len(asked) == 3


def test_a_look_holds_little_of_a_folder_with_thousands_of_files(
    watching: Callable[..., Watching], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(watching_module, "_MOST_PER_LOOK", 10)
    watched = watching()
    for number in range(3_000):
        (watched.folder / f"DJI_{number:05d}.JPG").touch()
    watched.look()
    for after_s in (0.0, 2.0):  # they settle; and each that is tried has no end
        tracemalloc.start()
        watched.look(after_s)
        _, peak = tracemalloc.get_traced_memory()
        tracemalloc.stop()
        assert peak / 3_000 < 150
