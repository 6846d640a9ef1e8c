"""What the simulated autopilot tells of its vehicle, camera and gimbal, as pymavlink reads it."""

import math
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from pymavlink import mavparm, mavutil, mavwp
from pymavlink.dialects.v20 import common as mavlink
from pymavlink.quaternion import QuaternionBase

from fvs_engine.lab.simulate.mavlink.flight_state import Faults

pytestmark = pytest.mark.process


class Station:
    """A ground station on a link of pymavlink's."""

    def __init__(self, url: str) -> None:
        self.link = mavutil.mavlink_connection(url, source_system=254)
        self.link.wait_heartbeat(timeout=10)

    def command(self, command: int, *parameters: float) -> int:
        """Do a command; returns its result."""
        padded = (*parameters, *[0.0] * (7 - len(parameters)))
        self.link.mav.command_long_send(1, 1, command, 0, *padded)
        acknowledged = self.link.recv_match(
            type="COMMAND_ACK", condition=f"COMMAND_ACK.command=={command}", blocking=True, timeout=10
        )
        return int(acknowledged.result)

    def asked(self, message: int, name: str) -> Any:
        """The message that the vehicle sends when it is asked for it."""
        self.link.mav.command_long_send(1, 1, mavlink.MAV_CMD_REQUEST_MESSAGE, 0, message, *[0.0] * 6)
        found = self.link.recv_match(type=name, blocking=True, timeout=10)
        assert found is not None, f"no {name}"
        return found

    def next(self, name: str) -> Any:
        """The next message of a type."""
        return self.link.recv_match(type=name, blocking=True, timeout=10)

    def parameters(self, count: int) -> dict[str, float]:
        """All parameters, of which there are ``count``."""
        self.link.param_fetch_all()
        found: dict[str, float] = {}
        while len(found) < count:
            value = self.next("PARAM_VALUE")
            assert value.param_count == count
            found[value.param_id] = value.param_value
        return found

    def received(self, name: str, seconds: float) -> int:
        """How many messages of a type come in this time."""
        count, until = 0, time.monotonic() + seconds
        while time.monotonic() < until:
            count += self.link.recv_match(type=name, blocking=True, timeout=0.05) is not None
        return count


@pytest.fixture
def station(simulated: Any) -> Callable[..., Any]:
    @contextmanager
    def connect(**vehicle: Any) -> Iterator[tuple[Any, Station]]:
        with simulated(**vehicle) as simulator:
            connected = Station(simulator.url)
            try:
                yield simulator, connected
            finally:
                connected.link.close()

    return connect


def test_it_says_what_it_is(station: Any) -> None:
    with station() as (simulator, ground):
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
        storage = ground.asked(mavlink.MAVLINK_MSG_ID_STORAGE_INFORMATION, "STORAGE_INFORMATION")
        assert 0 < storage.available_capacity <= storage.total_capacity
        gimbal = ground.asked(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION, "GIMBAL_MANAGER_INFORMATION")
        assert math.degrees(gimbal.pitch_min) == pytest.approx(-90.0)
        assert math.degrees(gimbal.pitch_max) == pytest.approx(30.0)
        status = ground.asked(mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_STATUS, "GIMBAL_MANAGER_STATUS")
        assert status.gimbal_device_id == gimbal.gimbal_device_id == camera.gimbal_device_id
        battery = ground.next("BATTERY_STATUS")
        assert (battery.battery_remaining, battery.time_remaining) == (100, 1_500)
        assert ground.next("SYSTEM_TIME").time_unix_usec >= 1_767_268_800_000_000
        assert ground.next("GPS_RAW_INT").fix_type == mavlink.GPS_FIX_TYPE_3D_FIX
        unknown = ground.command(mavlink.MAV_CMD_REQUEST_MESSAGE, mavlink.MAVLINK_MSG_ID_WIND_COV)
        assert unknown == mavlink.MAV_RESULT_UNSUPPORTED
        assert simulator.autopilot.vehicle.position.tolist() == [0.0, 0.0, 0.0]


def test_the_gimbal_points_where_it_is_told_and_photographs_have_its_attitude(station: Any) -> None:
    with station() as (simulator, ground):
        point = (mavlink.MAV_CMD_DO_GIMBAL_MANAGER_PITCHYAW, -40.0, math.nan)
        assert ground.command(*point) == mavlink.MAV_RESULT_DENIED  # on the ground
        assert ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == mavlink.MAV_RESULT_ACCEPTED
        assert ground.command(*point) == mavlink.MAV_RESULT_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_CONDITION_YAW, 130.0) == mavlink.MAV_RESULT_ACCEPTED
        vehicle = simulator.autopilot.vehicle
        until = time.monotonic() + 30.0
        while abs(vehicle.pitch_deg + 40.0) > 1e-6 or abs(vehicle.yaw_deg - 130.0) > 1e-6:
            assert time.monotonic() < until
            time.sleep(0.02)
        ground.next("GIMBAL_DEVICE_ATTITUDE_STATUS")  # one may have been sent before
        attitude = ground.next("GIMBAL_DEVICE_ATTITUDE_STATUS")
        assert attitude.flags & mavlink.GIMBAL_DEVICE_FLAGS_YAW_IN_VEHICLE_FRAME
        assert [math.degrees(angle) for angle in QuaternionBase(attitude.q).euler] == pytest.approx(
            [0.0, -40.0, 0.0], abs=0.01
        )
        assert ground.command(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1) == mavlink.MAV_RESULT_ACCEPTED
        photograph = ground.link.messages["CAMERA_IMAGE_CAPTURED"]
        assert [math.degrees(angle) for angle in QuaternionBase(photograph.q).euler] == pytest.approx(
            [0.0, -40.0, 130.0], abs=0.01
        )
        status = ground.asked(mavlink.MAVLINK_MSG_ID_CAMERA_CAPTURE_STATUS, "CAMERA_CAPTURE_STATUS")
        assert status.image_count == 1
        assert len(list(simulator.folder.glob("*.jpg"))) == 1


@pytest.mark.system
def test_messages_come_as_often_as_they_are_asked_for(station: Any) -> None:
    with station() as (_simulator, ground):
        vfr, accepted = mavlink.MAVLINK_MSG_ID_VFR_HUD, mavlink.MAV_RESULT_ACCEPTED
        interval = mavlink.MAV_CMD_SET_MESSAGE_INTERVAL
        assert ground.command(interval, vfr, -1.0) == accepted
        ground.received("VFR_HUD", 0.3)
        assert ground.received("VFR_HUD", 0.6) == 0
        assert ground.command(interval, vfr, 1.0) == accepted
        assert ground.received("VFR_HUD", 1.0) >= 2
        assert ground.received("CAMERA_SETTINGS", 0.6) == 0
        assert ground.command(interval, mavlink.MAVLINK_MSG_ID_CAMERA_SETTINGS, 1.0) == accepted
        assert ground.received("CAMERA_SETTINGS", 1.0) >= 2
        assert ground.command(interval, mavlink.MAVLINK_MSG_ID_WIND_COV, 1.0) != accepted


def test_parameters_are_those_that_change_the_flight(station: Any) -> None:
    with station() as (simulator, ground):
        assert ground.parameters(7) == {
            "FS_GCS_ENABLE": 0.0,
            "RTL_ALT": 1_500.0,
            "WPNAV_RADIUS": 100.0,
            "WPNAV_SPEED": 500.0,
            "BATT_CAPACITY": 5_000.0,
            "BATT_LOW_MAH": 750.0,
            "BATT_CRT_MAH": 150.0,
        }
        assert mavparm.MAVParmDict().mavset(ground.link, "RTL_ALT", 2_500.0)
        assert ground.link.param_fetch_one("RTL_ALT") is None
        assert ground.next("PARAM_VALUE").param_value == 2_500.0
        ground.link.mav.param_set_send(1, 1, b"RTL_ALT", -5.0, mavlink.MAV_PARAM_TYPE_REAL32)
        assert ground.next("PARAM_VALUE").param_value == 2_500.0  # not taken
        vehicle = simulator.autopilot.vehicle
        vehicle.position[:] = [60.0, 0.0, 5.0]
        ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        ground.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH)
        highest, until = 0.0, time.monotonic() + 30.0
        while vehicle.position[2] > 0.0:
            highest = max(highest, float(vehicle.position[2]))
            assert time.monotonic() < until
            time.sleep(0.005)
        assert highest == pytest.approx(25.0, abs=1.5)


def test_a_battery_parameter_is_the_failsafe(station: Any) -> None:
    with station() as (simulator, ground):
        assert mavparm.MAVParmDict().mavset(ground.link, "BATT_LOW_MAH", 4_500.0)
        simulator.autopilot.vehicle.battery = 0.91
        assert ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0) == mavlink.MAV_RESULT_ACCEPTED
        until = time.monotonic() + 30.0
        while ground.next("STATUSTEXT").text != "RTL: Battery low":
            assert time.monotonic() < until
        assert 0.88 < simulator.autopilot.vehicle.battery <= 0.9
        battery = ground.next("BATTERY_STATUS")
        assert battery.current_consumed >= 500


def test_px4_has_its_own_modes_and_parameters(station: Any) -> None:
    with station(firmware="px4") as (_simulator, ground):
        assert ground.next("HEARTBEAT").autopilot == mavlink.MAV_AUTOPILOT_PX4
        assert ground.link.flightmode == "LOITER"
        for name in ("RTL", "LAND", "LOITER"):  # pymavlink knows their numbers
            _, main, sub = mavutil.px4_map[name]
            assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, main, sub) == mavlink.MAV_RESULT_ACCEPTED
            until = time.monotonic() + 10.0
            while ground.link.flightmode != name:
                ground.next("HEARTBEAT")
                assert time.monotonic() < until
        manual = ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 1.0, 0.0)
        assert manual == mavlink.MAV_RESULT_DENIED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_DENIED  # it has none
        found = ground.parameters(6)
        assert (found["RTL_RETURN_ALT"], found["NAV_ACC_RAD"]) == (15.0, 1.0)
        assert found["BAT_CRIT_THR"] == pytest.approx(0.15)


def test_missions_go_there_and_back_by_pymavlinks_loader(station: Any) -> None:
    with station() as (_simulator, ground):
        loader = mavwp.MAVWPLoader()
        for number in range(4):
            loader.add_latlonalt(47.3769 + number * 1e-4, 8.5417, 10.0 + number)
        ground.link.waypoint_count_send(loader.count())
        while (asked := ground.link.recv_match(blocking=True, timeout=10)) is not None:
            if asked.get_type() == "MISSION_REQUEST_INT":
                assert (asked.target_system, asked.target_component) == (254, ground.link.source_component)
                item = loader.wp(asked.seq)
                ground.link.mav.send(mavutil.mavlink.MAVLink_mission_item_int_message(
                    1, 1, asked.seq, item.frame, item.command, item.current, 1, item.param1, item.param2,
                    item.param3, item.param4, round(item.x * 1e7), round(item.y * 1e7), item.z,
                ))  # fmt: skip
            elif asked.get_type() == "MISSION_ACK":
                assert asked.type == mavlink.MAV_MISSION_ACCEPTED
                break
        ground.link.waypoint_request_list_send()
        assert ground.next("MISSION_COUNT").count == loader.count()
        for number in range(loader.count()):
            ground.link.mav.mission_request_int_send(1, 1, number)
            got = ground.next("MISSION_ITEM_INT")
            assert got.x * 1e-7 == pytest.approx(loader.wp(number).x, abs=1e-7)
            assert got.z == loader.wp(number).z


def test_without_camera_and_gimbal_it_says_so(station: Any) -> None:
    faults = Faults(no_camera=True, no_gimbal=True)
    with station(faults=faults) as (simulator, ground):
        for message in (
            mavlink.MAVLINK_MSG_ID_CAMERA_INFORMATION,
            mavlink.MAVLINK_MSG_ID_GIMBAL_MANAGER_INFORMATION,
        ):
            answer = ground.command(mavlink.MAV_CMD_REQUEST_MESSAGE, message)
            assert answer == mavlink.MAV_RESULT_UNSUPPORTED
        ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        ground.command(mavlink.MAV_CMD_IMAGE_START_CAPTURE, 0, 0, 1)
        assert list(simulator.folder.glob("*.jpg")) == []
