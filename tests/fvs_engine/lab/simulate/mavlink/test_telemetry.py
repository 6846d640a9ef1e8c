"""What the simulated autopilot tells of its vehicle, camera and gimbal, as pymavlink reads it."""

import math
import time
from typing import Any

import pytest
from pymavlink import mavparm, mavutil
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from pymavlink.quaternion import QuaternionBase
from simulators import Station

from fvs_engine.lab.simulate.mavlink.autopilot import Setup
from fvs_engine.lab.simulate.mavlink.flight_state import Faults

pytestmark = pytest.mark.process

ACCEPTED, FAILED, UNSUPPORTED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_FAILED,
    mavlink.MAV_RESULT_UNSUPPORTED,
)
GUIDED, RTL = 4, 6
CAMERA = mavlink.MAV_COMP_ID_CAMERA


def test_it_says_what_it_is(flown: Any) -> None:
    with flown() as (simulator, ground):
        version = ground.asked(mavlink.MAVLINK_MSG_ID_AUTOPILOT_VERSION, "AUTOPILOT_VERSION")
        assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MISSION_INT
        assert version.capabilities & mavlink.MAV_PROTOCOL_CAPABILITY_MAVLINK2
        home = ground.asked(mavlink.MAVLINK_MSG_ID_HOME_POSITION, "HOME_POSITION")
        assert (home.latitude, home.longitude, home.altitude) == (473_769_000, 85_417_000, 440_000)
        camera = ground.asked(mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION, "CAMERA_INFORMATION")
        assert (camera.resolution_h, camera.resolution_v) == (64, 48)
        field = 2.0 * math.degrees(math.atan(0.5 * camera.sensor_size_h / camera.focal_length))
        assert field == pytest.approx(75.1, abs=0.1)
        assert camera.flags == mavlink.CAMERA_CAP_FLAGS_CAPTURE_IMAGE
        assert ground.asked(mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS, "CAMERA_SETTINGS").mode_id == 0
        storage = ground.asked(mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION, "STORAGE_INFORMATION", CAMERA)
        assert 0 < storage.available_capacity <= storage.total_capacity
        gimbal = ground.asked(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION, "GIMBAL_MANAGER_INFORMATION")
        assert math.degrees(gimbal.pitch_min) == pytest.approx(-90.0)
        assert math.degrees(gimbal.pitch_max) == pytest.approx(30.0)
        status = ground.asked(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS, "GIMBAL_MANAGER_STATUS")
        assert status.gimbal_device_id == gimbal.gimbal_device_id == camera.gimbal_device_id
        battery = ground.next("BATTERY_STATUS")
        assert (battery.battery_remaining, battery.time_remaining) == (100, 1_500)
        assert ground.next("SYSTEM_TIME").time_unix_usec >= 1_767_268_800_000_000
        assert ground.next("GPS_RAW_INT").fix_type >= mavlink.GPS_FIX_TYPE_3D_FIX
        landed = ground.asked(mavlink.MAVLINK_MSG_ID_EXTENDED_SYS_STATE, "EXTENDED_SYS_STATE").landed_state
        assert landed == mavlink.MAV_LANDED_STATE_ON_GROUND
        ground.mav.timesync_send(0, 1_234)
        assert ground.next("TIMESYNC", lambda message: message.ts1 == 1_234).tc1 > 0
        unknown = ground.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_WIND_COV)
        assert unknown == FAILED
        assert simulator.autopilot.vehicle.position.tolist() == [0.0, 0.0, 0.0]


def test_a_request_to_all_components_has_two_answers(flown: Any) -> None:
    with flown() as (_simulator, ground):
        request = (mavlink.MAV_CMD_REQUEST_MESSAGE, 0, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION, *[0.0] * 6)
        ground.mav.command_long_send(1, 0, *request)
        answers = [message for message in ground.listen(0.5) if message.get_type() == "COMMAND_ACK"]
        assert [(each.get_srcComponent(), each.result) for each in answers] == [(1, 0), (CAMERA, 0)]
        found = [message for message in ground.heard if message.get_type() == "CAMERA_INFORMATION"]
        assert [(each.get_srcComponent(), each.gimbal_device_id) for each in found] == [(1, 1), (CAMERA, 0)]
        ground.mav.command_long_send(1, 7, *request)  # a component that it does not have
        assert not [message for message in ground.listen(0.5) if message.get_type() == "COMMAND_ACK"]


@pytest.mark.parametrize(
    ("reports", "told", "kind"),
    [
        ("both", {"CAMERA_FEEDBACK", "CAMERA_IMAGE_CAPTURED"}, 6.0),
        ("feedback", {"CAMERA_FEEDBACK"}, 1.0),
        ("captured", {"CAMERA_IMAGE_CAPTURED"}, 6.0),
        ("none", set(), 1.0),
    ],
)
def test_a_camera_reports_as_it_is_set_up(flown: Any, reports: Any, told: set[str], kind: float) -> None:
    with flown(setup=Setup(reports), speed_up=1.0) as (simulator, ground):
        ground.mav.param_request_read_send(1, 1, b"CAM1_TYPE", -1)
        assert ground.next("PARAM_VALUE", lambda message: message.param_id == "CAM1_TYPE").param_value == kind
        photograph = (mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0.0, 0.0, 1.0)
        assert ground.command(*photograph) == ACCEPTED
        ground.listen(0.3)
        names = {message.get_type() for message in ground.heard}
        assert names & {"CAMERA_FEEDBACK", "CAMERA_IMAGE_CAPTURED"} == told
        feedback = [message for message in ground.heard if message.get_type() == "CAMERA_FEEDBACK"]
        assert [each.img_idx for each in feedback] == [1] * ("CAMERA_FEEDBACK" in told)
        assert len(list(simulator.folder.glob("*.jpg"))) == 1
        count = ground.asked(
            mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS, "CAMERA_CAPTURE_STATUS"
        ).image_count
        assert count == 1


def test_a_shutter_that_is_still_pressed_takes_no_photograph(flown: Any) -> None:
    with flown(setup=Setup("feedback"), speed_up=0.1) as (_simulator, ground):
        photograph = (mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0.0, 0.0, 1.0)
        assert ground.command(*photograph) == ACCEPTED
        assert ground.command(*photograph) == FAILED
        ground.listen(1.2)
        assert ground.command(*photograph) == ACCEPTED


def test_the_gimbal_points_where_it_is_told_and_photographs_have_its_attitude(flown: Any) -> None:
    with flown() as (simulator, ground):
        manager = (mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, -2.0, -2.0)
        assert ground.command(*manager) == ACCEPTED
        status = ground.asked(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS, "GIMBAL_MANAGER_STATUS")
        assert status.primary_control_sysid == 254
        point = (mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, -40.0, math.nan)
        assert ground.command(*point) == ACCEPTED
        vehicle = simulator.autopilot.vehicle
        wait_for(lambda: abs(vehicle.pitch_deg + 40.0) < 1e-6)
        ground.next("GIMBAL_DEVICE_ATTITUDE_STATUS")  # one may have been sent before
        attitude = ground.next("GIMBAL_DEVICE_ATTITUDE_STATUS")
        assert attitude.flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
        assert degrees(attitude.q) == pytest.approx([0.0, -40.0, 0.0], abs=0.01)
        take_off(ground)
        wait_for(lambda: vehicle.position[2] > 5.0)
        assert ground.command(mavlink.MAV_CMD_CONDITION_YAW, 130.0) == ACCEPTED
        wait_for(lambda: abs(vehicle.yaw_deg - 130.0) < 1e-6)
        assert ground.command(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1) == ACCEPTED
        [photograph] = [each for each in ground.heard if each.get_type() == "CAMERA_IMAGE_CAPTURED"]
        assert degrees(photograph.q) == pytest.approx([0.0, -40.0, 130.0], abs=0.01)


def test_streams_come_when_they_are_asked_for(flown: Any) -> None:
    with flown() as (_simulator, ground):
        ground.mav.request_data_stream_send(1, 1, mavlink.MAV_DATA_STREAM_ALL, 0, 0)
        ground.listen(0.3)
        names = {message.get_type() for message in ground.listen(0.6)}
        assert names <= {"HEARTBEAT", "TIMESYNC"}
        ground.mav.request_data_stream_send(1, 1, mavlink.MAV_DATA_STREAM_POSITION, 4, 1)
        names = {message.get_type() for message in ground.listen(0.6)}
        assert names <= {"HEARTBEAT", "TIMESYNC", "GLOBAL_POSITION_INT", "LOCAL_POSITION_NED"}
        assert "GLOBAL_POSITION_INT" in names


@pytest.mark.system
def test_messages_come_as_often_as_they_are_asked_for(flown: Any) -> None:
    with flown() as (_simulator, ground):
        vfr, interval = mavlink.MAVLINK_MSG_ID_VFR_HUD, mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        assert ground.command(interval, vfr, -1.0) == ACCEPTED
        ground.listen(0.3)
        assert count(ground, "VFR_HUD", 0.6) == 0
        assert ground.command(interval, vfr, 1.0) == ACCEPTED
        assert count(ground, "VFR_HUD", 1.0) >= 2
        assert count(ground, "CAMERA_SETTINGS", 0.6) == 0
        assert ground.command(interval, mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS, 1.0) == ACCEPTED
        assert count(ground, "CAMERA_SETTINGS", 1.0) >= 2
        assert ground.command(interval, mavlink.MAVLINK_MSG_ID_WIND_COV, 1.0) != ACCEPTED


def test_parameters_change_the_flight(flown: Any) -> None:
    with flown() as (simulator, ground):
        found = parameters(ground)
        assert {
            "FS_GCS_ENABLE": 0.0,
            "RTL_ALT": 1_500.0,
            "WPNAV_RADIUS": 100.0,
            "MIS_TOTAL": 0.0,
        }.items() <= found.items()
        assert mavparm.MAVParmDict().mavset(ground.link, "RTL_ALT", 2_500.0)
        ground.mav.param_set_send(1, 1, b"RTL_ALT", math.nan, mavlink.MAV_PARAM_TYPE_REAL32)
        ground.mav.param_request_read_send(1, 1, b"RTL_ALT", -1)
        ground.listen(0.3)
        assert ground.link.param_fetch_one("RTL_ALT") is None
        assert ground.next("PARAM_VALUE").param_value == 2_500.0
        vehicle = simulator.autopilot.vehicle
        ground.mode(GUIDED)
        ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        vehicle.position[:] = [60.0, 0.0, 5.0]
        ground.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        highest, until = 0.0, time.monotonic() + 30.0
        while vehicle.position[2] > 0.0:
            highest = max(highest, float(vehicle.position[2]))
            assert time.monotonic() < until
            time.sleep(0.005)
        assert highest == pytest.approx(25.0, abs=1.5)


def test_px4_has_its_own_modes_and_parameters(flown: Any) -> None:
    with flown(firmware="px4") as (_simulator, ground):
        beat = ground.next("HEARTBEAT", lambda message: message.get_srcComponent() == 1)
        assert beat.autopilot == mavlink.MAV_AUTOPILOT_PX4
        for name in ("RTL", "LAND", "LOITER"):  # pymavlink knows their numbers
            _, main, sub = mavutil.px4_map[name]
            assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, main, sub) == ACCEPTED
            number = main << 16 | sub << 24
            ground.next("HEARTBEAT", lambda message, number=number: message.custom_mode == number)
        not_now = mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 1.0, 0.0) == not_now  # there are no sticks
        found = parameters(ground)
        assert (found["RTL_RETURN_ALT"], found["NAV_ACC_RAD"]) == (15.0, 1.0)
        assert found["BAT_CRIT_THR"] == pytest.approx(0.15)


def test_without_camera_and_gimbal_it_accepts_to_tell_and_tells_nothing(flown: Any) -> None:
    with flown(faults=Faults(no_camera=True, no_gimbal=True)) as (simulator, ground):
        for message in (
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION,
        ):
            assert ground.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message) == ACCEPTED
        ground.listen(0.3)
        names = {message.get_type() for message in ground.heard}
        assert not names & {"CAMERA_INFORMATION", "GIMBAL_MANAGER_INFORMATION"}
        assert ground.command(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1) == FAILED
        assert list(simulator.folder.glob("*.jpg")) == []


def test_px4_without_camera_does_not_know_the_message(flown: Any) -> None:
    with flown(firmware="px4", faults=Faults(no_camera=True)) as (_simulator, ground):
        request = (mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION)
        assert ground.command(*request) == UNSUPPORTED


def take_off(ground: Station) -> None:
    assert ground.mode(GUIDED) == ACCEPTED
    assert ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == ACCEPTED
    assert ground.command(mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0) == ACCEPTED


def parameters(ground: Station) -> dict[str, float]:
    ground.link.param_fetch_all()
    found: dict[str, float] = {}
    value = None
    while value is None or len(found) < value.param_count:
        value = ground.next("PARAM_VALUE")
        found[value.param_id] = value.param_value
    return found


def count(ground: Station, name: str, seconds: float) -> int:
    return sum(message.get_type() == name for message in ground.listen(seconds))


def degrees(quaternion: list[float]) -> list[float]:
    return [math.degrees(angle) for angle in QuaternionBase(quaternion).euler]


def wait_for(condition: Any) -> None:
    until = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < until
        time.sleep(0.02)
