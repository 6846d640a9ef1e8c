"""Vehicles that refuse to return, fall silent or are taken over at the end, without a simulator."""

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from fvs_client.fly.dialects import PX4, Mode
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.flight import Ending, FlightSettings
from fvs_client.fly.homecoming import Homecoming
from fvs_client.fly.items import Command, Frame, MissionItem
from fvs_client.fly.log import FlightLog
from fvs_client.fly.places import Home
from fvs_client.fly.settings import EndedError
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.watch import Watch

_SETTINGS = FlightSettings("north", 3, silence_s=0.2)


class Played:
    """A vehicle that flies; ``answer`` gets the mode that it is told to take, and how often it was told one.

    It lands at once when it returns or lands, unless ``answer`` raises.
    """

    home = Home(47.0, 8.0, 440.0)
    dialect = PX4

    def __init__(self, answer: Callable[[Mode, int], None], mode: Mode = Mode.MISSION) -> None:
        self.last_state = VehicleState(armed=True, mode=mode)
        self.told: list[Mode] = []
        self.silent = False
        self._answer = answer

    @property
    def state(self) -> VehicleState:
        if self.silent:
            raise NoAnswerError("The vehicle has been silent for 20 s.")
        return self.last_state

    def set_mode(self, mode: Mode) -> None:
        self.told.append(mode)
        self._answer(mode, len(self.told))
        self.last_state = replace(self.last_state, mode=mode, armed=False)

    def said(self, _seconds: float) -> list[str]:
        return []

    def warnings(self) -> list[str]:
        return []

    def recover_captures(self) -> None: ...


@pytest.fixture(autouse=True)
def _no_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvs_client.fly.homecoming._AGAIN_S", 0.0)
    monkeypatch.setattr("fvs_client.fly.homecoming.POLL_S", 0.0)


def come_home(vehicle: Any, *, paused: bool = False, settings: FlightSettings = _SETTINGS) -> list[str]:
    """How a flight ends when its vehicle comes home."""
    said: list[str] = []
    log = FlightLog(None, said.append)
    watch = Watch(vehicle, settings, log)
    watch.items = [MissionItem(Command.WAYPOINT, Frame.GLOBAL), MissionItem(20, Frame.MISSION)]
    with watch.commanding(Mode.PAUSE if paused else Mode.MISSION):
        watch.flies()
    if paused:
        watch.paused.set()
    Homecoming(vehicle, watch, settings, log).wait()
    return said


def test_a_return_that_is_refused_is_tried_again() -> None:
    def refuses_twice(_mode: Mode, times: int) -> None:
        if times <= 2:
            raise VehicleError("The autopilot answers MAV_CMD_DO_SET_MODE with MAV_RESULT_DENIED.")

    vehicle = Played(refuses_twice)
    said = come_home(vehicle)
    assert vehicle.told == [Mode.RETURN] * 3
    assert "MAV_RESULT_DENIED. Trying again." in said[0]  # once
    assert said[1:] == ["The vehicle has landed."]


def test_a_vehicle_that_never_returns_is_to_land() -> None:
    def refuses_to_return(mode: Mode, _times: int) -> None:
        if mode is Mode.RETURN:
            raise VehicleError("The vehicle does not change to RETURN.")

    vehicle = Played(refuses_to_return, Mode.PAUSE)
    said = come_home(vehicle, paused=True)
    assert vehicle.told == [*[Mode.RETURN] * 5, Mode.LAND]
    assert said[-2:] == ["It does not return: it is to land where it is.", "The vehicle has landed."]


def test_a_command_without_an_answer_is_sent_again_while_the_vehicle_is_heard() -> None:
    def answers_the_third(_mode: Mode, times: int) -> None:
        if times < 3:
            raise NoAnswerError("The vehicle does not answer a command.")

    vehicle = Played(answers_the_third)
    come_home(vehicle)
    assert vehicle.told == [Mode.RETURN] * 3


@pytest.mark.parametrize("paused", [False, True])
def test_a_vehicle_that_stays_silent_has_not_landed(paused: bool) -> None:
    vehicle = Played(lambda _mode, _times: None)
    vehicle.silent = True
    with pytest.raises(EndedError, match="Its landing was not seen: The vehicle has been silent") as ended:
        come_home(vehicle, paused=paused)
    assert ended.value.ending is Ending.VEHICLE
    assert ("It was paused" in ended.value.reason) is paused
    assert vehicle.told == []


@pytest.mark.parametrize("mode", [Mode.OTHER, Mode.HOLD, Mode.PAUSE])
def test_a_vehicle_that_others_fly_gets_no_command(mode: Mode) -> None:
    vehicle = Played(lambda _mode, _times: None, mode)
    with pytest.raises(EndedError, match="a pilot or another ground station has taken over") as ended:
        come_home(vehicle)
    assert ended.value.ending is Ending.PILOT
    assert vehicle.told == []


def test_a_vehicle_that_stays_in_the_air_is_not_waited_for_without_end() -> None:
    vehicle = Played(lambda _mode, _times: None, Mode.RETURN)
    began = time.monotonic()
    with pytest.raises(EndedError, match="it is in the air after 0 s"):
        come_home(vehicle, settings=replace(_SETTINGS, leg_s=0.1))
    assert time.monotonic() - began < 10.0
    assert vehicle.told == []


def test_a_return_of_the_mission_gets_no_command() -> None:
    """ArduPilot stays in AUTO when the return is an item of its mission."""
    vehicle = Played(lambda _mode, _times: None)
    vehicle.last_state = replace(vehicle.last_state, item=1)
    with pytest.raises(EndedError, match="it is in the air after 0 s"):
        come_home(vehicle, settings=replace(_SETTINGS, leg_s=0.1))
    assert vehicle.told == []


def test_a_pilot_who_takes_a_returning_vehicle_keeps_it() -> None:
    """Also in a mode that the flight has commanded before."""

    class Taken(Played):
        modes = iter([Mode.RETURN, Mode.MISSION])

        @property
        def state(self) -> VehicleState:
            return replace(self.last_state, mode=next(self.modes))

    vehicle = Taken(lambda _mode, _times: None)
    with pytest.raises(EndedError, match="has taken over") as ended:
        come_home(vehicle)
    assert ended.value.ending is Ending.PILOT
    assert vehicle.told == []


def test_a_mission_that_has_returned_begins_anew_before_the_motors_are_off() -> None:
    """So ArduPilot tells it: item 0 comes before the heartbeat that says disarmed."""

    class Landing(Played):
        states = iter([(1, True), (0, True), (0, False)])

        @property
        def state(self) -> VehicleState:
            item, armed = next(self.states)
            return replace(self.last_state, item=item, armed=armed)

    vehicle = Landing(lambda _mode, _times: None)
    assert come_home(vehicle) == ["The vehicle has landed."]
    assert vehicle.told == []
