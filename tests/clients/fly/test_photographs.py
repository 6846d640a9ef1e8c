"""Photographs of a flight in a folder that has those of earlier flights."""

import time
from collections.abc import Callable, Collection
from pathlib import Path

from fvs_client.fly.captures import Capture
from fvs_client.fly.photographs import Photographs
from fvs_client.spool import Outbox, Refusal, Settings, State
from fvs_client.spool.folder import find_file
from fvs_client.spool.outbox import FILE_NAME
from fvs_client.spool.retrying import retry
from fvs_client.spool.taking import take

SCENE = "scn_1"


def _acknowledge(outbox: Outbox, name: str) -> None:
    (number,) = [one.number for one in outbox.all() if one.name == name]
    outbox.acknowledge(number, "accepted")


def test_photographs_of_earlier_flights_are_not_waited_for(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    for number, name in enumerate(("sent.jpg", "waits.jpg", "new-to-the-outbox.jpg"), 1):
        (tmp_path / name).write_bytes(photograph(number))
    with Outbox(tmp_path / FILE_NAME) as outbox:
        for name in ("sent.jpg", "waits.jpg"):
            take(outbox, find_file(tmp_path / name), SCENE)
        _acknowledge(outbox, "sent.jpg")
        quick = Settings(settle_s=0.05, look_every_s=0.05)
        nowhere = "http://127.0.0.1:9"
        with Photographs(
            tmp_path, SCENE, url=nowhere, api_key=None, say=lambda _: None, settings=quick
        ) as photographs:
            assert photographs.wait(0, 0.0)
            (tmp_path / "of-this-flight.jpg").write_bytes(photograph(4))
            assert not photographs.wait(1, 30.0, give_up=lambda: len(outbox.all()) == 4)
            for name in ("waits.jpg", "new-to-the-outbox.jpg"):
                _acknowledge(outbox, name)
            assert not photographs.wait(1, 0.3)
            _acknowledge(outbox, "of-this-flight.jpg")
            assert photographs.wait(1, 30.0)
            assert photographs.left == 0


def _name(photographs: Photographs, named: Collection[str] = ()) -> str | None:
    tested = photographs.tested(named)
    return None if tested is None else tested.path.name


def _arrived(photographs: Photographs, count: int) -> list[tuple[int, str, bool]]:
    """The next photographs of the flight, when so many have come."""
    arrived: list[Capture] = []
    until = time.monotonic() + 30.0
    while len(arrived) < count:
        assert time.monotonic() < until
        arrived += photographs.arrived()
    return [(one.number, one.file, one.succeeded) for one in arrived]


def _spool(folder: Path) -> Photographs:
    quick = Settings(settle_s=0.05, look_every_s=0.05)
    return Photographs(
        folder, SCENE, url="http://127.0.0.1:9", api_key=None, say=lambda _: None, settings=quick
    )


def test_a_camera_that_is_switched_on_again_writes_the_same_names(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    (tmp_path / "DJI_0001.JPG").write_bytes(photograph(1))
    with _spool(tmp_path) as photographs:
        (tmp_path / "DJI_0001.JPG").write_bytes(photograph(2))
        assert _arrived(photographs, 1) == [(0, "DJI_0001.JPG", True)]


def test_a_raw_file_that_comes_before_its_jpeg_is_no_photograph(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    with _spool(tmp_path) as photographs, Outbox(tmp_path / FILE_NAME) as outbox:
        until = time.monotonic() + 30.0
        for number in range(2):
            (tmp_path / f"{number}.DNG").write_bytes(photograph(number))
            while len(outbox.all()) < 2 * number + 1:
                assert time.monotonic() < until
                time.sleep(0.02)
            (tmp_path / f"{number}.JPG").write_bytes(photograph(number + 10))
            assert _arrived(photographs, 1) == [(number, f"{number}.JPG", True)]


def test_a_test_photograph_that_comes_late_is_known_by_its_name(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    with _spool(tmp_path) as photographs:
        photographs.test()
        assert _name(photographs, {"test.jpg"}) is None
        photographs.begin()
        (tmp_path / "test.jpg").write_bytes(photograph(1))
        until = time.monotonic() + 30.0
        while _name(photographs) != "test.jpg":
            assert time.monotonic() < until
        (tmp_path / "view.jpg").write_bytes(photograph(2))
        assert _arrived(photographs, 1) == [(0, "view.jpg", True)]


def test_the_test_photograph_is_not_sent_and_belongs_to_no_view(
    tmp_path: Path, photograph: Callable[..., bytes]
) -> None:
    said: list[str] = []
    quick = Settings(settle_s=0.05, look_every_s=0.05)
    with Photographs(
        tmp_path, SCENE, url="http://127.0.0.1:9", api_key=None, say=said.append, settings=quick
    ) as photographs:
        until = time.monotonic() + 30.0
        photographs.test()
        assert photographs.tested() is None
        (tmp_path / "test.jpg").write_bytes(photograph(1))
        while _name(photographs) != "test.jpg":
            assert time.monotonic() < until
        photographs.begin()
        (tmp_path / "view.jpg").write_bytes(photograph(2))
        arrived = []
        while not arrived and time.monotonic() < until:
            arrived = photographs.arrived()
        assert [(one.file, one.succeeded) for one in arrived] == [("view.jpg", True)]
        assert photographs.arrived() == []
        with Outbox(tmp_path / FILE_NAME) as outbox:
            (number,) = [one.number for one in outbox.all() if one.name == "view.jpg"]
            outbox.refuse(number, Refusal("not-an-image", "It is no image."))
            assert [one.state for one in outbox.all()] == [State.REFUSED] * 2
            assert outbox.counts()[State.REFUSED] == 1
        assert [(one.file, one.succeeded) for one in photographs.arrived()] == [("view.jpg", False)]
    with Outbox(tmp_path / FILE_NAME) as outbox:
        assert [one.name for one in retry(outbox)] == ["view.jpg"]
    assert any("test.jpg is not sent. It is the test photograph" in line for line in said)
