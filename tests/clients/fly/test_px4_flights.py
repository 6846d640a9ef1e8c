"""Flights of a simulated PX4 that rejects missions or changes its mode."""

import time
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from flights import SURVEY, Flown, working
from fvs_client import Scene
from fvs_client.fly import vehicle
from fvs_client.fly.flight import Ending

pytestmark = pytest.mark.process


def test_a_mission_that_px4_takes_and_does_not_fly_is_not_begun(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    low = replace(SURVEY, height_m=1.5)
    with simulated(firmware="px4") as simulator, ExitStack() as stack:
        result = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", survey=low).result()
        assert not simulator.autopilot._state.armed
    assert result.ending is Ending.VEHICLE
    assert "does not fly it: Mission rejected: Takeoff altitude too low!" in result.reason


@pytest.mark.system
def test_a_mission_that_px4_does_not_fly_in_the_air_brings_it_home(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated(firmware="px4") as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 3)
        first = simulator.autopilot.mission
        simulator.autopilot._pilot.objection = lambda: (
            None if simulator.autopilot.mission == first else "Mission rejected: too far"
        )
        with working(gateway, scene):
            result = flown.result()
        assert not simulator.autopilot._state.armed
    assert result.ending is Ending.VEHICLE
    assert "Mission rejected: too far" in result.reason
    assert flown.events("landed")


@pytest.mark.system
def test_a_failsafe_of_px4_that_holds_first_is_waited_for(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated(firmware="px4") as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", reserve=0.0)
        flown.wait_for("photograph", 3)
        simulator.autopilot._pilot._board.parameters._values["COM_FAIL_ACT_T"] = 25.0
        simulator.autopilot.vehicle.battery = 0.1
        result = flown.result()
        assert not simulator.autopilot._state.armed
    assert result.ending is Ending.VEHICLE
    assert "commanded by its failsafe" in result.reason
    assert flown.events("landed")


@pytest.mark.system
def test_a_mission_that_begins_with_its_upload_is_not_begun_twice(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PX4 begins it with the upload, and has photographed before it is read back."""
    read_back = vehicle.require_same

    def slow(*arguments: Any) -> None:
        read_back(*arguments)
        time.sleep(1.5)  # 45 s of the vehicle

    monkeypatch.setattr(vehicle, "require_same", slow)
    with simulated(firmware="px4") as simulator, working(gateway, scene), ExitStack() as stack:
        Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl").result()
        assert len(list(simulator.folder.glob("*.jpg"))) == 6  # with the one on the ground
