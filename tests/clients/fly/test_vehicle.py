"""The connection to a vehicle: missions, modes, photographs and what goes wrong, over real MAVLink."""

import json
import math
import time
from typing import Any

import pytest
from flights import begin
from fvs_client.fly.dialects import ARDUPILOT, Mode
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.items import Command, Frame, MissionItem, holding
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Vehicle
from PIL import Image
from pymavlink import mavutil

pytestmark = pytest.mark.process

SURVEY = Survey(47.3769, 8.5417, radius_m=25.0, height_m=12.0, target_height_m=5.0, count=3)


def captured(vehicle: Vehicle, count: int) -> list[Any]:
    found: list[Any] = []
    until = time.monotonic() + 60.0
    while len(found) < count:
        found += [
            one for one in vehicle.captures() if one.source[:2] == ("image", 100)
        ]  # of the camera itself
        assert time.monotonic() < until
        time.sleep(0.02)
    return found


@pytest.mark.parametrize("firmware", ["ardupilot", pytest.param("px4", marks=pytest.mark.system)])
def test_a_survey_is_flown_and_photographed(simulated: Any, firmware: str) -> None:
    with simulated(firmware=firmware) as simulator, Vehicle(simulator.url) as vehicle:
        assert vehicle.dialect.autopilot == firmware
        assert vehicle.state.latitude_deg == pytest.approx(47.3769, abs=1e-6)
        assert not vehicle.state.armed
        items = holding(SURVEY.items(vehicle.dialect), 5.0)
        begin(vehicle, items)
        photographs = captured(vehicle, 3)
        vehicle.wait(lambda: vehicle.state.item >= len(items) - 2, 60.0, "does not wait for more")
        assert [photograph.succeeded for photograph in photographs] == [True] * 3
        # It returns by itself. Height and arming come in messages of their own: either may be first.
        vehicle.wait(
            lambda: not vehicle.state.armed and abs(vehicle.state.height_m) < 0.3, 60.0, "does not land"
        )
        assert 0.5 < vehicle.state.battery < 1.0
        for number, photograph in enumerate(photographs):
            file = simulator.folder / photograph.file
            told = json.loads(file.with_name(f"{file.name}.json").read_text())
            north_m = (told["latitude_deg"] - 47.3769) * 111_195.0
            east_m = (told["longitude_deg"] - 8.5417) * 111_195.0 * math.cos(math.radians(47.3769))
            direction = math.radians(120.0 * number)
            assert (north_m, east_m) == pytest.approx(
                (25.0 * math.cos(direction), 25.0 * math.sin(direction)), abs=1.1
            )
            assert told["altitude_m"] == pytest.approx(452.0, abs=0.6)
            assert told["yaw_deg"] == pytest.approx((120.0 * number + 180.0) % 360.0, abs=4.0)
            assert told["pitch_deg"] == pytest.approx(math.degrees(math.atan2(-7.0, 25.0)), abs=0.1)
            with Image.open(file) as image:
                assert image.size == (64, 48)
                assert image.getexif().get_ifd(0x8825)[1] == "N"


def test_a_mission_arrives_as_it_was_sent(simulated: Any) -> None:
    items = holding(SURVEY.items(ARDUPILOT), 7.0)
    with simulated() as simulator:
        with Vehicle(simulator.url) as vehicle:
            vehicle.upload(items)
        time.sleep(0.3)
        station = mavutil.mavlink_connection(simulator.url, source_system=254)
        station.wait_heartbeat(timeout=10)
        station.mav.mission_request_list_send(1, 1)
        count = station.recv_match(type="MISSION_COUNT", blocking=True, timeout=10).count
        assert count == len(items)
        for number, sent in enumerate(items):
            station.mav.mission_request_int_send(1, 1, number)
            got = station.recv_match(type="MISSION_ITEM_INT", blocking=True, timeout=10)
            assert (got.command, got.x, got.y) == (sent.command, *sent.encoded)
            assert got.param1 == pytest.approx(sent.parameters[0], abs=1.0)  # in whole numbers, for some
        station.close()


def test_a_mission_that_the_autopilot_refuses_names_the_item(simulated: Any) -> None:
    items = SURVEY.items(ARDUPILOT)
    items.insert(3, MissionItem(82, Frame.RELATIVE, x=47.0, y=8.0))  # a spline
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        with pytest.raises(VehicleError, match=r"MAV_MISSION_UNSUPPORTED, at item 3 \(command 82\)"):
            vehicle.upload(items)
        simulator.autopilot.faults.refuses_missions = True
        with pytest.raises(VehicleError, match="MAV_MISSION_DENIED"):
            vehicle.upload(SURVEY.items(ARDUPILOT))
        with pytest.raises(VehicleError, match="MAV_CMD_NAV_TAKEOFF"):
            vehicle.command(22)


@pytest.mark.system
@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_a_pause_holds_and_home_is_home(simulated: Any, firmware: str) -> None:
    with simulated(firmware=firmware) as simulator, Vehicle(simulator.url) as vehicle:
        begin(vehicle, SURVEY.items(vehicle.dialect))
        captured(vehicle, 1)
        vehicle.pause()
        time.sleep(0.4)
        before = vehicle.state
        time.sleep(0.4)  # twenty seconds of the vehicle's
        after = vehicle.state
        assert (after.mode, after.item) == (
            Mode.PAUSE,
            before.item,
        )
        assert abs(after.latitude_deg - before.latitude_deg) * 111_195.0 < 1.0
        assert vehicle.captures() == []
        vehicle.resume(before.item)
        [photograph] = captured(vehicle, 1)
        assert photograph.place is not None
        north_m = (photograph.place[0] - 47.3769) * 111_195.0
        assert north_m == pytest.approx(25.0 * math.cos(math.radians(120.0)), abs=1.5)  # not where it paused
        vehicle.set_mode(Mode.RETURN)
        vehicle.wait(lambda: not vehicle.state.armed, 60.0, "does not land")
        assert vehicle.captures() == []


@pytest.mark.system
def test_a_low_battery_sends_it_home(simulated: Any) -> None:
    with simulated(endurance_s=120.0) as simulator, Vehicle(simulator.url) as vehicle:
        items = holding(SURVEY.items(ARDUPILOT), 3_600.0)
        begin(vehicle, items)
        vehicle.wait(lambda: vehicle.state.mode == Mode.RETURN, 60.0, "does not return")
        assert "Battery Failsafe" in vehicle.said(60.0)


def test_a_photograph_that_fails_is_told(simulated: Any) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        simulator.autopilot.faults.failing_photographs.add(1)
        begin(vehicle, SURVEY.items(ARDUPILOT))
        assert [photograph.succeeded for photograph in captured(vehicle, 3)] == [True, False, True]
        assert len(list(simulator.folder.glob("*.jpg"))) == 2


@pytest.mark.system
def test_a_vehicle_that_never_answers_is_named(simulated: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.2)
    monkeypatch.setattr("fvs_client.fly.link._SILENCE_S", 1.0)
    with simulated() as simulator:
        with Vehicle(simulator.url) as vehicle:
            simulator.autopilot.faults.silent = True
            with pytest.raises(NoAnswerError, match=r"does not answer|silent"):
                vehicle.upload([MissionItem(Command.WAYPOINT, Frame.GLOBAL)])
            time.sleep(1.1)
            with pytest.raises(NoAnswerError, match="silent for"):
                _ = vehicle.state
        with pytest.raises(NoAnswerError, match=r"No heartbeat|silent"):
            Vehicle(simulator.url, timeout_s=1.0)
    with pytest.raises(NoAnswerError, match="cannot be opened"):
        Vehicle(simulator.url)  # nobody listens there any more
