"""Lost acknowledgements during a mission upload."""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import Flown, working
from fvs_client import Scene
from fvs_client.fly.flight import Ending
from pymavlink.dialects.v20 import common as mavlink

from fvs_engine.lab.simulate.mavlink.flight_state import Mode

pytestmark = pytest.mark.process


@pytest.mark.system
def test_a_mission_that_begins_without_an_answer_is_flown(
    simulated: Any,
    relay: Any,
    gateway: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.3)

    def lost(message: Any) -> bool:
        kind = message.get_type()
        return bool(kind == "COMMAND_ACK" and message.command == mavlink.MAV_CMD_MISSION_START)

    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = lambda message: [] if lost(message) else [message]
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", link=link.url, photographs=4)
        result = flown.result()
        assert not flown.vehicle.state.armed
    assert (result.ending, result.photographs, result.failed) == (Ending.BUDGET, 4, 0)


@pytest.mark.system
def test_a_link_that_stays_lost_between_two_missions_leaves_a_vehicle_that_comes_home(
    simulated: Any,
    relay: Any,
    gateway: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.2)
    monkeypatch.setattr("fvs_client.fly.link._SILENCE_S", 1.0)
    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        log = tmp_path / "flight.jsonl"
        flown = Flown(
            stack, simulator, scene, url, log, link=link.url, photographs=4, silence_s=1.0, patience_s=600.0
        )
        flown.wait_for("photograph", 3)

        def cut(message: Any) -> list[Any]:
            link.cut |= message.get_type() == "MISSION_REQUEST"
            return [] if link.cut else [message]

        link.edit = cut
        result = flown.result()
        assert simulator.autopilot.mode is Mode.MISSION
        until = time.monotonic() + 90.0
        while simulator.autopilot.vehicle.position[2] > 0.0:
            assert time.monotonic() < until
            time.sleep(0.05)
    assert result.ending is Ending.VEHICLE
    assert "Its landing was not seen" in result.reason


@pytest.mark.system
def test_a_vehicle_that_may_have_taken_off_is_sent_home(
    simulated: Any, relay: Any, scene: Scene, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.3)
    monkeypatch.setattr("fvs_client.fly.flight._TRIES", 1)
    started_s: list[float] = []
    last: list[Any] = []

    def edit(message: Any) -> list[Any]:
        """Answers to the start command are lost, and heartbeats report the previous mode for 3 s."""
        kind = message.get_type()
        if kind == "COMMAND_ACK" and message.command == mavlink.MAV_CMD_MISSION_START:
            started_s.append(time.monotonic())
            return []
        if kind == "HEARTBEAT":
            if not started_s or time.monotonic() > started_s[0] + 3.0:
                last[:] = [message]
            return last
        return [message]

    with simulated() as simulator, ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = edit
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", link=link.url)
        result = flown.result()
        assert not simulator.autopilot._state.armed
    assert result.ending is Ending.VEHICLE
    assert "does not answer a command" in result.reason
    assert result.photographs == 0
