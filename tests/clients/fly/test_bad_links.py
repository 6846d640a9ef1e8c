"""Links with other traffic, with messages that come twice, late or not at all, and that break off."""

import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from flights import begin
from fvs_client.fly.captures import Capture
from fvs_client.fly.dialects import ARDUPILOT, Mode
from fvs_client.fly.errors import NoAnswerError, VehicleError
from fvs_client.fly.items import holding
from fvs_client.fly.survey import Survey
from fvs_client.fly.vehicle import Vehicle
from pymavlink.dialects.v20 import common as mavlink

from fvs_engine.lab.simulate.mavlink.flight_state import Faults

pytestmark = pytest.mark.process

SURVEY = Survey(47.3769, 8.5417, radius_m=25.0, height_m=12.0, target_height_m=5.0, count=3)


class Other:
    """Somebody else on the link: makes messages of another system or component."""

    def __init__(self, system: int, component: int = 1) -> None:
        self._mav = mavlink.MAVLink(None, srcSystem=system, srcComponent=component)

    def says(self, message: Any) -> Any:
        message.pack(self._mav)
        return message

    def heartbeat(self, kind: int = mavlink.MAV_TYPE_QUADROTOR, autopilot: int = 3, armed: int = 0) -> Any:
        return self.says(mavlink.MAVLink_heartbeat_message(kind, autopilot, armed, 6, 4, 3))


@contextmanager
def beside(link: Any, *others: Any) -> Iterator[None]:
    """Others speak after each heartbeat of the vehicle."""
    link.edit = lambda message: [message, *others] if message.get_type() == "HEARTBEAT" else [message]
    yield


def captured(vehicle: Vehicle, count: int) -> list[Capture]:
    found: list[Capture] = []
    until = time.monotonic() + 60.0
    while len(found) < count:
        found += [one for one in vehicle.captures() if one.source.message == "image"]  # of the camera itself
        assert time.monotonic() < until, f"{len(found)} of {count}"
        time.sleep(0.02)
    return found


def test_another_vehicle_is_named_and_its_messages_are_not_heard(simulated: Any, relay: Any) -> None:
    far = Other(7).says(mavlink.MAVLink_global_position_int_message(0, 10, 10, 10, 10, 0, 0, 0, 0))
    armed = mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    with simulated() as simulator:
        link = relay(simulator.url)
        with beside(link, Other(7).heartbeat(armed=armed), far):
            with pytest.raises(VehicleError, match="vehicles 1 and 7 are on this link") as refused:
                Vehicle(link.url)
            assert "--system" in refused.value.hint
            with Vehicle(link.url, system=1) as vehicle:
                time.sleep(0.5)
                assert vehicle.state.latitude_deg == pytest.approx(47.3769, abs=1e-6)
                assert not vehicle.state.armed
                vehicle.set_mode(Mode.HOLD)
            with pytest.raises(NoAnswerError, match="Vehicle 9 sends no heartbeat, but 1, 7 does"):
                Vehicle(link.url, system=9, timeout_s=2.0)


@pytest.mark.parametrize(
    ("kind", "firmware", "reason"),
    [
        (mavlink.MAV_TYPE_FIXED_WING, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, "is no copter"),
        (mavlink.MAV_TYPE_GROUND_ROVER, mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA, "is no copter"),
        (mavlink.MAV_TYPE_VTOL_TILTROTOR, mavlink.MAV_AUTOPILOT_PX4, "is no copter"),
        (mavlink.MAV_TYPE_QUADROTOR, mavlink.MAV_AUTOPILOT_GENERIC, "firmware is not known"),
    ],
)
def test_planes_rovers_and_unknown_firmware_are_refused_when_they_are_heard(
    simulated: Any, relay: Any, kind: int, firmware: int, reason: str
) -> None:
    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = lambda message: (
            [Other(1).heartbeat(kind, firmware)] if message.get_type() == "HEARTBEAT" else [message]
        )
        with pytest.raises(VehicleError, match=reason):
            Vehicle(link.url)


@pytest.mark.system
def test_ground_stations_and_cameras_are_no_vehicles(simulated: Any, relay: Any) -> None:
    invalid = mavlink.MAV_AUTOPILOT_INVALID
    station = Other(255, 190).heartbeat(mavlink.MAV_TYPE_GCS, invalid)
    odd_station = Other(254).heartbeat(mavlink.MAV_TYPE_GCS, mavlink.MAV_AUTOPILOT_GENERIC)
    camera = Other(1, 100).heartbeat(mavlink.MAV_TYPE_CAMERA, invalid, mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
    with simulated() as simulator:
        link = relay(simulator.url)
        with beside(link, station, odd_station, camera), Vehicle(link.url) as vehicle:
            time.sleep(0.5)
            assert not vehicle.state.armed
            vehicle.upload(SURVEY.items(ARDUPILOT))
        link.edit = lambda message: [station] if message.get_type() == "HEARTBEAT" else [message]
        with pytest.raises(NoAnswerError, match="No heartbeat"):
            Vehicle(link.url, timeout_s=2.0)


def test_a_program_that_stood_still_sends_nothing_again(
    simulated: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.1)
    monkeypatch.setattr("fvs_client.fly.link.STOOD_STILL_S", 0.2)
    sent = []

    def stands_still() -> bool:
        time.sleep(0.5)
        return False

    with (
        simulated() as simulator,
        Vehicle(simulator.url) as vehicle,
        pytest.raises(VehicleError, match="This program stood still for"),
    ):
        vehicle._link.ask(lambda: sent.append("arm"), ("MISSION_ACK",), "command", done=stands_still)
    assert sent == ["arm"]


def test_answers_to_others_are_not_ours(simulated: Any, relay: Any) -> None:
    vehicle_says = Other(1).says
    done = vehicle_says(mavlink.MAVLink_mission_ack_message(255, 190, mavlink.MAV_MISSION_ACCEPTED))
    asks = vehicle_says(mavlink.MAVLink_mission_request_int_message(255, 190, 9_999))
    denied = vehicle_says(
        mavlink.MAVLink_command_ack_message(
            mavlink.MAV_CMD_DO_SET_MODE, mavlink.MAV_RESULT_DENIED, 0, 0, 255, 190
        )
    )
    late = vehicle_says(mavlink.MAVLink_mission_ack_message(245, 191, mavlink.MAV_MISSION_ACCEPTED))
    strange = (done, asks, denied, late)
    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = lambda message: (
            [*strange, message] if message.get_type() in ("MISSION_REQUEST", "COMMAND_ACK") else [message]
        )
        with Vehicle(link.url) as vehicle:
            vehicle.set_mode(Mode.HOLD)
            vehicle.upload(SURVEY.items(ARDUPILOT))
            assert len(simulator.autopilot.mission) == len(SURVEY.items(ARDUPILOT))


def test_requests_come_twice_and_in_any_order(simulated: Any, relay: Any) -> None:
    items = holding(SURVEY.items(ARDUPILOT), 10.0)
    before: list[Any] = []

    def twice_and_late(message: Any) -> list[Any]:
        if message.get_type() != "MISSION_REQUEST":
            return [message]
        before.append(message)
        return [message, *before[-3:-1], message]

    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = twice_and_late
        with Vehicle(link.url) as vehicle:
            vehicle.upload(items)
            sent = [(item.command, round(item.parameters[0], 3)) for item in items]
            got = simulator.autopilot.mission
            assert [(item.command, round(item.parameters[0], 3)) for item in got] == sent


@pytest.mark.system
def test_messages_that_are_lost_are_sent_again(
    simulated: Any, relay: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_client.fly.link._ANSWER_S", 0.3)
    lost = {"MISSION_REQUEST": 0, "MISSION_ACK": 0, "COMMAND_ACK": 0}

    def every_other(message: Any) -> list[Any]:
        kind = message.get_type()
        if kind not in lost:
            return [message]
        lost[kind] += 1
        return [] if lost[kind] % 2 else [message]

    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = every_other
        with Vehicle(link.url) as vehicle:
            begin(vehicle, SURVEY.items(ARDUPILOT))
            assert len(captured(vehicle, 3)) == 3
    assert min(lost.values()) >= 2


@pytest.mark.system
def test_reports_of_photographs_that_were_lost_are_asked_for(simulated: Any, relay: Any) -> None:
    dropped = []

    def drop_first_and_last(message: Any) -> list[Any]:
        if message.get_type() == "CAMERA_IMAGE_CAPTURED" and message.image_index not in (1, *dropped):
            dropped.append(message.image_index)
            return []
        return [message]

    with simulated() as simulator:
        link = relay(simulator.url)
        link.edit = drop_first_and_last
        with Vehicle(link.url) as vehicle:
            assert vehicle.equipment().camera == "fvs simulated"
            items = holding(SURVEY.items(ARDUPILOT), 3_000.0)
            begin(vehicle, items)
            vehicle.wait(lambda: vehicle.state.item == len(items) - 2, 60.0, "does not wait for more")
            assert {found.number for found in captured(vehicle, 2)} == {0, 1}  # the gap was seen
            vehicle.recover_captures()
            [last] = captured(vehicle, 1)
            assert (last.number, last.succeeded) == (2, True)
    assert dropped == [0, 2]


@pytest.mark.system
def test_equipment_is_what_the_vehicle_reports(simulated: Any) -> None:
    with simulated() as simulator, Vehicle(simulator.url) as vehicle:
        found = vehicle.equipment()
        assert found.camera == "fvs simulated"
        assert found.gimbal_deg == pytest.approx((-90.0, 30.0))
    with simulated(faults=Faults(no_camera=True)) as simulator, Vehicle(simulator.url) as vehicle:
        found = vehicle.equipment()
        assert found.camera is None
        assert found.gimbal_deg is not None


def test_a_link_that_breaks_off_prints_nothing(
    simulated: Any, relay: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    with simulated() as simulator:
        link = relay(simulator.url)
        with Vehicle(link.url) as vehicle:
            link.close()
            time.sleep(0.5)
            assert vehicle.last_state.located
    assert capsys.readouterr() == ("", "")


def test_a_program_may_have_imported_pymavlink_before() -> None:
    """pymavlink's default is MAVLink 1, which has no messages for cameras."""
    program = """
from pymavlink import mavutil
from fvs_client.fly.link import Link
link = Link("udpin:127.0.0.1:0", baud=0, system=None, heard=print)
print(link.mavlink.__name__)
link.close()
"""
    environment = {name: value for name, value in os.environ.items() if name != "MAVLINK20"}
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "pymavlink.dialects.v20.ardupilotmega"
