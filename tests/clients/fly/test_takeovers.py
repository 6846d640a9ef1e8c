"""Pauses, and pilots and ground stations that take over: a flight does not change the mode then."""

import io
import sys
import time
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from threading import Event
from typing import Any

import pytest
from flights import Flown, working
from fvs_client import AnswerTimeoutError, Scene
from fvs_client.cli import fly as command
from fvs_client.fly.dialects import Mode as Told
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending
from pymavlink.dialects.v20 import common as mavlink
from simulators import Station

from fvs_engine.lab.simulate.mavlink.flight_state import Mode

pytestmark = pytest.mark.process


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)


@pytest.mark.system
@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_a_pause_between_legs_lasts_until_it_is_ended(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path, firmware: str
) -> None:
    with simulated(firmware=firmware) as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", photographs=4)
        flown.wait_for("photograph", 3)
        flown.flight.pause()
        paused = simulator.autopilot.mode
        assert paused in (Mode.GUIDED, Mode.LOITER)
        with working(gateway, scene):
            flown.wait_for("goes", 1)  # it knows where to go next
            time.sleep(1.0)  # 30 s of the vehicle
            assert simulator.autopilot.mode is paused
            assert len(flown.events("photograph")) == 3
            flown.flight.resume()
            result = flown.result()
        assert not flown.vehicle.state.armed
    assert (result.ending, result.photographs) == (Ending.BUDGET, 4)


def test_a_pause_without_a_ground_station_ends_at_home(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    """``FS_OPTIONS`` is 16, as it is by default: a failsafe leaves modes alone in which a pilot flies."""
    with simulated() as simulator, ExitStack() as stack:
        station = Station(simulator.url, system=255)
        stack.callback(station.link.close)
        for name in (b"FS_GCS_ENABLE", b"FS_GCS_TIMEOUT"):
            station.mav.param_set_send(1, 1, name, 1.0, mavlink.MAV_PARAM_TYPE_REAL32)
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 1)
        flown.flight.pause()
        station.beat()
        result = flown.result()
        assert not flown.vehicle.state.armed
    assert "is in RTL, commanded by its failsafe (it says: GCS Failsafe)" in result.reason


@pytest.mark.system
@pytest.mark.parametrize(
    ("firmware", "mode"), [("ardupilot", Mode.LOITER), ("ardupilot", Mode.BRAKE), ("px4", Mode.LOITER)]
)
def test_a_pilot_keeps_the_vehicle(
    simulated: Any, gateway: Any, scene: Scene, url: str, tmp_path: Path, firmware: str, mode: Mode
) -> None:
    with simulated(firmware=firmware) as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 3)
        before = flown.vehicle.state.custom_mode
        simulator.autopilot._pilot.enter(mode, "remote control")
        until(lambda: flown.vehicle.state.custom_mode != before)
        with working(gateway, scene):
            result = flown.result()
        assert simulator.autopilot.mode is mode
        assert flown.vehicle.state.armed
        with pytest.raises(VehicleError, match="flight has ended"):
            flown.flight.pause()
        assert simulator.autopilot.mode is mode
    assert result.ending is Ending.PILOT
    assert "has taken over" in result.reason
    assert (result.photographs, result.unsent) == (3, 0)


@pytest.mark.system
@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_another_station_replaces_the_mission(
    simulated: Any, scene: Scene, url: str, tmp_path: Path, firmware: str
) -> None:
    away = {"command": 16, "x": 473779000, "y": 85417000, "z": 20.0}
    with simulated(firmware=firmware) as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 1)
        station = Station(simulator.url)
        stack.callback(station.link.close)
        assert station.upload([away, away, away, away]) == 0
        result = flown.result()
        assert flown.vehicle.state.armed
    assert result.ending is Ending.PILOT
    assert "another ground station has replaced the mission: it has " in result.reason


def test_a_pilot_who_takes_over_on_the_way_home_keeps_the_vehicle(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 1)
        flown.flight.return_home()
        until(lambda: flown.vehicle.state.mode is Told.RETURN)
        simulator.autopilot._pilot.enter(Mode.LOITER, "remote control")
        result = flown.result()
        assert simulator.autopilot.mode is Mode.LOITER
    assert result.ending is Ending.PILOT


@pytest.mark.system
@pytest.mark.parametrize("call", ["rank", "report_visits"])
def test_a_service_that_does_not_answer_keeps_no_vehicle_in_the_air(
    simulated: Any,
    gateway: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    call: str,
) -> None:
    called, answers = Event(), Event()

    def hang(*_: Any, **__: Any) -> None:
        called.set()
        assert answers.wait(120.0)
        raise AnswerTimeoutError("It does not answer.")

    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 1)
        if call == "report_visits":
            flown.wait_for("goes", 1)
        monkeypatch.setattr(Scene, call, hang)
        if call == "rank":
            assert called.wait(60.0)
        flown.flight.return_home()
        flown.wait_for("landed", 1)
        answers.set()
        assert flown.result().ending is Ending.STOPPED
        assert called.is_set()


@pytest.mark.system
def test_a_pilot_who_holds_the_vehicle_when_it_has_armed_keeps_it(
    simulated: Any, relay: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:
        link = relay(simulator.url)

        def edit(message: Any) -> list[Any]:
            if (
                message.get_type() == "COMMAND_ACK"
                and message.command == mavlink.MAV_CMD_COMPONENT_ARM_DISARM
            ):
                simulator.autopilot._state.mode = Mode.BRAKE
            return [message]

        link.edit = edit
        result = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", link=link.url).result()
        assert simulator.autopilot.mode is Mode.BRAKE
        assert simulator.autopilot.vehicle.flown_m == 0.0
    assert result.ending is Ending.PILOT


def test_commands_go_on_after_one_that_fails(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    done = []

    class Refusing:
        def pause(self) -> None:
            raise VehicleError("The vehicle does not change to PAUSE.")

        def resume(self) -> None:
            done.append("resume")

        def return_home(self) -> None:
            done.append("home")

    monkeypatch.setattr(sys, "stdin", io.StringIO("pause\nhome\n"))
    command._commands(Refusing())  # type: ignore[arg-type]
    assert done == ["home"]
    assert "does not change to PAUSE" in capsys.readouterr().err
