"""Where a vehicle is, and where home is: before a fix, after arming, far away."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from flights import SURVEY, Flown, working
from fvs_client import Scene
from fvs_client.fly.dialects import ARDUPILOT
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending
from fvs_client.fly.link import Link
from fvs_client.fly.places import Home, off_m
from fvs_client.fly.start import require_near
from fvs_client.fly.telemetry import VehicleState
from fvs_client.fly.vehicle import Vehicle
from pymavlink.dialects.v20 import common as mavlink

from fvs_engine.lab.simulate.vehicle import Wind

pytestmark = pytest.mark.process

HOME = Home(47.3769, 8.5417, 440.0)


def says(message: Any) -> Any:
    message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    return message


def test_zeros_before_a_fix_are_no_position(
    simulated: Any, relay: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """ArduPilot's ``GLOBAL_POSITION_INT`` before a fix."""
    nothing: list[str] = []

    def before(message: Any) -> list[Any]:
        match message.get_type():
            case "GPS_RAW_INT":
                message.fix_type = 1
            case "GLOBAL_POSITION_INT":
                message.lat = message.lon = message.alt = message.relative_alt = 0
            case "HOME_POSITION":
                return []
        return [says(message)]

    def after(message: Any) -> list[Any]:
        return before(message) if len(nothing) < 1 else [message]

    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = after
        said: list[str] = []

        def say(line: str) -> None:
            said.append(line)
            nothing.append(line)

        with Vehicle(link.url, say=say) as vehicle:
            assert vehicle.state.latitude_deg == pytest.approx(47.3769, abs=1e-6)
            assert vehicle.home.moved_m(HOME) < 0.1
            link.edit = before  # in flight the last position is kept
            assert vehicle.state.located
        assert said[0] == "The vehicle has no GPS fix yet (GPS_RAW_INT: fix_type 0): waiting for it."
        monkeypatch.setattr("fvs_client.fly.connection._FIX_S", 0.5)
        with pytest.raises(VehicleError, match=r"has no GPS fix yet .*fix_type 1"):
            Vehicle(link.url)


def test_a_vehicle_that_the_wind_carries_away_is_to_return(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl")
        flown.wait_for("photograph", 1)
        simulator.autopilot.vehicle.wind = Wind((60.0, 0.0))
        flown.wait_for("ends", 1)
        simulator.autopilot.vehicle.wind = Wind()
        result = flown.result()
        assert not flown.vehicle.state.armed
    assert result.ending is Ending.VEHICLE
    assert "m off its way: too much wind, or a wrong position" in result.reason


@pytest.mark.parametrize(
    ("here", "away_m"),
    [
        ((47.0, 8.0005), 0.0),
        ((47.0002, 8.0005), 22.2),
        ((46.9998, 7.9990), 79.0),
        ((47.0010, 8.0012), 15.2),
    ],
)
def test_off_the_way_is_off_its_nearest_line(here: tuple[float, float], away_m: float) -> None:
    way = [(47.0, 8.0), (47.0, 8.0), (47.0, 8.001), (47.002, 8.001)]
    assert off_m(here, way) == pytest.approx(away_m, abs=0.2)


@pytest.mark.parametrize("drift_m", [1.0, 6.0])
def test_a_mission_is_made_again_where_arming_moves_home(
    simulated: Any, relay: Any, scene: Scene, url: str, tmp_path: Path, gateway: Any, drift_m: float
) -> None:
    armed: list[bool] = []

    def drift(message: Any) -> list[Any]:
        if message.get_type() == "HEARTBEAT":
            armed.extend([True] if message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED else [])
        if message.get_type() == "HOME_POSITION" and armed:
            message.altitude += round(drift_m * 1e3)
            says(message)
        return [message]

    with simulated() as simulator, working(gateway, scene), ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = drift
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", link=link.url, photographs=3)
        assert flown.result().ending is Ending.BUDGET
    again = [event["text"] for event in flown.events("home") if "made again" in event["text"]]
    assert again == (
        ["Home has moved by 6.0 m since the mission was made. The mission is made again."]
        if drift_m > 2.0
        else []
    )
    assert len(flown.events("survey")) == len(again) + 1


def test_a_mission_that_begins_far_away_or_high_up_is_refused() -> None:
    items = SURVEY.items(ARDUPILOT)
    here = VehicleState(latitude_deg=47.3769, longitude_deg=8.5417, altitude_m=440.0, height_m=0.0)
    require_near(items, here, HOME, {})
    nowhere = replace(here, latitude_deg=0.0, longitude_deg=0.0)
    with pytest.raises(VehicleError, match=r"begins 5[0-9]{6} m from the vehicle") as refused:
        require_near(items, nowhere, HOME, {})
    assert "--geofence" in refused.value.hint
    high = [replace(item, z=453.0) if item.placed else item for item in items]
    with pytest.raises(VehicleError, match="453 m above home") as refused:
        require_near(high, here, HOME, {})
    assert "--highest" in refused.value.hint
    require_near(high, here, HOME, {"highest_height_m": 500.0})
    require_near(items, replace(here, latitude_deg=47.39), HOME, {"geofence": "given"})


def test_a_vehicle_that_speaks_mavlink_1_is_refused(
    simulated: Any, relay: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._VERSION_2_S", 0.5)

    def old(message: Any) -> list[Any]:
        if message.get_type() != "HEARTBEAT":
            return []
        message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1), force_mavlink1=True)
        return [message]

    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = old
        with pytest.raises(VehicleError, match="speaks MAVLink 1") as refused:
            Vehicle(link.url)
        assert "SERIALn_PROTOCOL" in refused.value.hint


def test_a_second_client_is_refused(simulated: Any, relay: Any) -> None:
    other = mavlink.MAVLink_heartbeat_message(18, 8, 0, 0, 4, 3)
    other.pack(mavlink.MAVLink(None, srcSystem=245, srcComponent=191))
    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = lambda message: [other, message]
        for system in (None, 1):
            with pytest.raises(VehicleError, match="Another fvs-client"):
                Vehicle(link.url, system=system)


def test_the_first_of_two_clients_keeps_the_vehicle(simulated: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as first:
        monkeypatch.setattr("fvs_client.fly.link._OTHERS_S", 30.0)  # it ends when the other is heard
        with pytest.raises(VehicleError, match="Another fvs-client"):
            Vehicle(simulator.url)
        assert first.version() is not None


def test_its_heartbeats_are_not_those_of_a_ground_station() -> None:
    """A failsafe for lost ground stations counts those of ``MAV_GCS_SYSID``, 255 by default."""
    heard = Link("udpin:127.0.0.1:0", baud=0, system=None, heard=print)
    try:
        assert (heard._link.mav.srcSystem, heard._link.mav.srcComponent) == (245, 191)
    finally:
        heard.close()
