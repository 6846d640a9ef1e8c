"""Commands whose answers are lost: they are not sent again to a vehicle that a pilot has taken over."""

from collections.abc import Callable, Iterator
from contextlib import suppress
from threading import Event
from typing import Any

import pytest
from flights import SURVEY, begin
from fvs_client.fly.dialects import Mode as Told
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import holding
from fvs_client.fly.vehicle import Vehicle
from pymavlink.dialects.v20 import common as mavlink

from fvs_engine.lab.simulate.mavlink.flight_state import Mode

pytestmark = pytest.mark.process

_SEEN = 3
"""Number of heartbeats after which the client knows what the command has done."""


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.5)
    monkeypatch.setattr("fvs_client.fly.vehicle._CHANGE_S", 0.5)


@pytest.fixture(params=["ardupilot", "px4"])
def linked(request: pytest.FixtureRequest, simulated: Any, relay: Any) -> Iterator[tuple[Any, Any, Vehicle]]:
    with simulated(firmware=request.param) as simulator:
        link = relay(simulator.url)
        with Vehicle(link.url) as vehicle:
            yield simulator, link, vehicle


def remote(simulator: Any, **changed: Any) -> None:
    """Do as a pilot does by a remote control."""
    for name, value in changed.items():
        setattr(simulator.autopilot._state, name, value)


def taken(link: Any, command: int, take: Callable[[], object]) -> Event:
    """Lose the answers to a command, and ``take`` the vehicle over once it has been seen to act.

    Returns what is set then.
    """
    answered: list[Any] = []
    over = Event()
    heartbeats: list[Any] = []

    def edit(message: Any) -> list[Any]:
        if message.get_type() == "COMMAND_ACK" and message.command == command:
            answered.append(message)
            return []
        if message.get_type() == "HEARTBEAT" and message.get_srcComponent() == 1 and answered:
            heartbeats.append(message)
            if len(heartbeats) == _SEEN:
                take()
                over.set()
        return [message]

    link.edit = edit
    return over


def test_the_mode(linked: tuple[Any, Any, Vehicle]) -> None:
    simulator, link, vehicle = linked
    begin(vehicle, holding(SURVEY.items(vehicle.dialect), 600.0))
    over = taken(link, mavlink.MAV_CMD_DO_SET_MODE, lambda: remote(simulator, mode=Mode.LOITER))
    with suppress(VehicleError):
        vehicle.set_mode(Told.RETURN)
    assert over.wait(30.0)
    assert simulator.autopilot.mode is Mode.LOITER


def test_arming(linked: tuple[Any, Any, Vehicle]) -> None:
    simulator, link, vehicle = linked
    over = taken(link, mavlink.MAV_CMD_COMPONENT_ARM_DISARM, lambda: remote(simulator, armed=False))
    with suppress(VehicleError):
        vehicle.arm()
    assert over.wait(30.0)
    assert not simulator.autopilot._state.armed


def test_the_start_of_a_mission(linked: tuple[Any, Any, Vehicle]) -> None:
    simulator, link, vehicle = linked
    items = holding(SURVEY.items(vehicle.dialect), 600.0)
    vehicle.upload(items)
    vehicle.arm()
    over = taken(link, mavlink.MAV_CMD_MISSION_START, lambda: remote(simulator, mode=Mode.LOITER))
    with suppress(VehicleError):
        vehicle.begin(1, len(items) - 1)
    assert over.wait(30.0)
    assert simulator.autopilot.mode is Mode.LOITER


def test_a_pilot_who_holds_the_vehicle_while_a_mission_begins_keeps_it(
    linked: tuple[Any, Any, Vehicle],
) -> None:
    simulator, link, vehicle = linked
    items = holding(SURVEY.items(vehicle.dialect), 600.0)
    begin(vehicle, items)
    link.edit = lambda message: [] if message.get_type() == "MISSION_CURRENT" else [message]
    vehicle.upload(items)
    remote(simulator, mode=Mode.BRAKE)
    vehicle.begin(1, len(items) - 1)
    assert simulator.autopilot.mode is Mode.BRAKE
