"""Flights whose own computer fails: the vehicle stays on the ground, or comes home first."""

import threading
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import Flown
from fvs_client import Scene
from fvs_client.fly.flight import Flight
from fvs_client.fly.log import FlightLog
from fvs_client.spool.errors import SpoolError
from fvs_client.spool.lock import only_sender
from fvs_client.spool.outbox import FILE_NAME

pytestmark = pytest.mark.process


def test_a_folder_that_another_spool_sends_from_is_refused_before_takeoff(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:
        stack.enter_context(only_sender(simulator.folder / FILE_NAME))
        with pytest.raises(SpoolError, match="Another process sends"):
            Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        assert simulator.autopilot.vehicle.flown_m == 0.0


@pytest.mark.system
def test_a_failure_in_the_air_is_raised_after_the_landing(
    simulated: Any, scene: Scene, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    raised: list[BaseException | None] = []
    monkeypatch.setattr(threading, "excepthook", lambda given: raised.append(given.exc_value))
    full = OSError(28, "No space left on device")

    def update(_flight: Flight) -> None:
        raise full

    monkeypatch.setattr(Flight, "_update", update)
    with simulated() as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.join()
        assert simulator.autopilot.vehicle.flown_m > 20.0
        assert not flown.vehicle.state.armed
    assert raised == [full]
    [event] = flown.events("ends")
    assert (event["ending"], "No space left" in event["text"]) == ("failed", True)
    assert flown.events("landed")


def test_a_log_that_cannot_be_written_is_said_once() -> None:
    said: list[str] = []
    log = FlightLog(Path("/dev/full"), said.append)
    for _ in range(3):
        log.event("position", "")
    [text] = said
    assert "/dev/full cannot be written" in text


def test_a_terminal_that_is_closed_leaves_the_log_alone(tmp_path: Path) -> None:
    def closed(_line: str) -> None:
        raise BrokenPipeError

    FlightLog(tmp_path / "flight.jsonl", closed).event("survey", "Survey.")
    assert "Survey." in (tmp_path / "flight.jsonl").read_text()
