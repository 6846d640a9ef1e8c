"""Checks before takeoff: the battery, and the checklist."""

import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import SURVEY, Flown
from fvs_client import Scene
from fvs_client.fly.checklist import Check, checklist
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending
from fvs_client.fly.settings import FlightSettings
from fvs_client.fly.vehicle import Vehicle
from pymavlink import mavutil
from pymavlink.dialects.v20 import common as mavlink

from fvs_engine.lab.simulate.vehicle import Wind

pytestmark = pytest.mark.process


def _of_vehicle(message: Any) -> Any:
    message.pack(mavlink.MAVLink(None, srcSystem=1, srcComponent=1))
    return message


def _without_battery(message: Any) -> list[Any]:
    if message.get_type() != "SYS_STATUS":
        return [message]
    fields = (0, 0, 0, 0, 65_535, -1, -1, 0, 0, 0, 0, 0, 0)
    return [_of_vehicle(mavlink.MAVLink_sys_status_message(*fields))]


def test_a_vehicle_without_a_battery_is_not_flown_with_a_reserve(
    simulated: Any, relay: Any, scene: Scene, url: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client.fly.equipment._BATTERY_S", 0.5)
    with simulated() as simulator, ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = _without_battery
        log = tmp_path / "flight.jsonl"
        result = Flown(stack, simulator, scene, url, log, link=link.url).result()
        assert simulator.autopilot.vehicle.flown_m == 0.0
    assert result.ending is Ending.VEHICLE
    assert "reports no battery" in result.reason
    assert "--unchecked" in result.reason


@pytest.mark.system
@pytest.mark.parametrize(("settings", "warned"), [({"equipment": False}, True), ({"reserve": 0.0}, False)])
def test_a_vehicle_without_a_battery_is_flown_without_a_reserve(
    simulated: Any,
    relay: Any,
    scene: Scene,
    url: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    settings: dict[str, Any],
    warned: bool,
) -> None:
    monkeypatch.setattr("fvs_client.fly.equipment._BATTERY_S", 0.5)
    with simulated() as simulator, ExitStack() as stack:
        link = relay(simulator.url)
        link.edit = _without_battery
        log = tmp_path / "flight.jsonl"
        flown = Flown(stack, simulator, scene, url, log, link=link.url, **settings)
        flown.wait_for("photograph", 1)
        flown.flight.return_home()
        assert flown.result().ending is Ending.STOPPED
    texts = [event["text"] for event in flown.events("warning")]
    assert any("reports no battery" in text for text in texts) is warned


def _set(url: str, parameters: dict[str, float]) -> None:
    """Change parameters as a ground station does, and wait until they are changed."""
    station = mavutil.mavlink_connection(url, source_system=252)
    for name, value in parameters.items():
        station.mav.param_set_send(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32)
        while station.recv_match(type="PARAM_VALUE", blocking=True, timeout=5.0).param_id != name:
            pass
    station.close()


def _found(vehicle: Vehicle, **settings: Any) -> dict[str, Check]:
    wanted = FlightSettings("north", 5, **settings)
    found = checklist(vehicle, wanted, vehicle.equipment(), Check("camera", "tried"))
    return {check.what: check for check in found}


def test_a_failsafe_that_counts_a_station_that_is_heard_is_fine(simulated: Any) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        _set(simulator.url, {"FS_GCS_ENABLE": 1.0})
        station = mavutil.mavlink_connection(simulator.url, source_system=255)
        for _ in range(3):
            station.mav.heartbeat_send(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 0)
            time.sleep(0.1)
        vehicle.wait(lambda: 255 in vehicle.stations, 5.0, "forwards no heartbeat")
        found = _found(vehicle)
        station.close()
    assert found["lost ground station"].fine
    assert "255" in found["who else commands"].found


def test_what_prevents_arming_is_told_in_the_words_of_the_vehicle(simulated: Any) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        _set(simulator.url, {"FENCE_ALT_MAX": -5.0, "FENCE_TYPE": 1.0, "FENCE_ENABLE": 1.0})
        check = _found(vehicle)["arming"]
    assert not check.fine
    assert check.found == "PreArm: Vehicle breaching Max Alt fence"


def test_a_refused_command_has_the_words_that_come_after_the_refusal(simulated: Any) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        _set(simulator.url, {"FENCE_ALT_MAX": -5.0, "FENCE_TYPE": 1.0, "FENCE_ENABLE": 1.0})
        with pytest.raises(VehicleError, match="says: PreArm: Vehicle breaching Max Alt fence"):
            vehicle.arm()


def test_the_checklist_says_where_the_flight_may_go(simulated: Any) -> None:
    around, elsewhere = "47.37,8.53;47.39,8.53;47.39,8.56;47.37,8.56", "47.47,8.53;47.49,8.53;47.49,8.55"
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        _set(simulator.url, {"ARMING_CHECK": 0.0, "FENCE_ENABLE": 1.0})
        limits = {"geofence": around, "lowest_height_m": 5.0, "highest_height_m": 60.0}
        found = _found(vehicle, survey=SURVEY, mission=limits)
        assert str(found["geofence"]) == "[ ok ] geofence: 4 corners, home is inside"
        assert found["heights"].found == "5 m to 60 m above home"
        assert found["arming"].remedy == "ARMING_CHECK 1"
        assert found["vehicle's fence"].remedy == (
            "FENCE_RADIUS: the flight may go 2005 m from home; "
            "FENCE_ALT_MAX: its ceiling is far above the flight's 60 m (--highest)"
        )
        found = _found(vehicle, mission={"geofence": elsewhere})
        assert "home is outside" in str(found["geofence"])
        assert not found["geofence"].fine
        found = _found(vehicle, survey=SURVEY)
    assert found["geofence"].remedy == "--geofence"
    assert found["heights"].found == "no lowest to 120 m above home"
    assert "the survey and back 115 m, 1 min or more; 24 m from home at most" in found["distance"].found


def test_checks_that_are_partly_off_and_a_wind_that_is_not_estimated_are_named(simulated: Any) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        vehicle.wait(lambda: vehicle.wind_m_s is not None, 5.0, "reports no wind")
        _set(simulator.url, {"ARMING_CHECK": 72.0})
        found = _found(vehicle)
    assert str(found["arming"]) == "[LOOK] arming: disarmed; some of its checks are off -> ARMING_CHECK 1"
    assert found["wind"].found == "not estimated: look yourself"


def test_a_strong_wind_and_a_vehicle_that_somebody_has_armed_are_named(simulated: Any) -> None:
    with simulated(wind=Wind((0.0, 11.0))) as simulator, Vehicle(simulator.url) as vehicle:
        vehicle.wait(lambda: vehicle.wind_m_s is not None, 5.0, "reports no wind")
        vehicle.arm()
        found = _found(vehicle)
    assert "11.0 m/s" in found["wind"].found
    assert not found["wind"].fine
    assert found["arming"].found == "armed already"
    assert not found["arming"].fine


def test_whole_numbers_of_px4_are_read_from_their_bits(simulated: Any) -> None:
    with simulated(firmware="px4") as simulator, Vehicle(simulator.url) as vehicle:
        values = vehicle.parameters(["SYS_AUTOSTART", "NAV_ACC_RAD", "NO_SUCH"])
    assert values == {"SYS_AUTOSTART": 4001.0, "NAV_ACC_RAD": 1.0}


def test_a_checklist_that_is_not_confirmed_leaves_the_vehicle_on_the_ground(
    simulated: Any, scene: Scene, url: str, tmp_path: Path
) -> None:
    with simulated() as simulator, ExitStack() as stack:
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", confirm=lambda _checks: False)
        result = flown.result()
        assert simulator.autopilot.vehicle.flown_m == 0.0
    assert result.ending is Ending.STOPPED
    assert "checklist" in result.reason
    assert len(flown.events("check")) > 10
