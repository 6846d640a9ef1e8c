"""Photographs of a flight in a folder that has those of earlier flights."""

from collections.abc import Callable
from pathlib import Path

from fvs_client.fly.photographs import Photographs
from fvs_client.spool import Outbox, Settings
from fvs_client.spool.folder import find_file
from fvs_client.spool.outbox import FILE_NAME
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
