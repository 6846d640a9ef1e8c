"""The simulated copter refuses, fails safe and lists as ArduCopter does."""

import math
import socket
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink
from simulators import Simulator, Station

from fvs_engine.lab.simulate.mavlink.autopilot import Setup

pytestmark = pytest.mark.process

STABILIZE, ALT_HOLD, AUTO, GUIDED, LOITER, RTL, LAND, POSHOLD, BRAKE = 0, 2, 3, 4, 5, 6, 9, 16, 17
ACCEPTED, DENIED, FAILED = mavlink.MAV_RESULT_ACCEPTED, mavlink.MAV_RESULT_DENIED, mavlink.MAV_RESULT_FAILED
LATITUDE, LONGITUDE = 473_769_000, 85_417_000
ARM = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)


def item(command: int, x: int = 0, y: int = 0, z: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"command": command, "x": x, "y": y, "z": z, **more}


HOME_ITEM = item(mavlink.MAV_CMD_NAV_WAYPOINT, LATITUDE, LONGITUDE, 440.0, frame=0)
TAKEOFF = item(mavlink.MAV_CMD_NAV_TAKEOFF, z=10.0)
NORTH = item(mavlink.MAV_CMD_NAV_WAYPOINT, LATITUDE + 3_000, LONGITUDE, 12.0)
WAIT = item(mavlink.MAV_CMD_NAV_LOITER_TIME, LATITUDE + 3_000, LONGITUDE, 12.0, param1=2_000.0)
RETURN = item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=2)
MISSION = [HOME_ITEM, TAKEOFF, NORTH, WAIT, RETURN]


def test_before_a_fix_its_position_is_zero_and_it_does_not_arm(flown: Any) -> None:
    with flown(setup=Setup(fix_after_s=60.0)) as (simulator, ground):
        position = ground.next("GLOBAL_POSITION_INT")
        assert (position.lat, position.lon, position.alt, position.relative_alt) == (0, 0, 0, 0)
        assert ground.next("GPS_RAW_INT").fix_type < mavlink.GPS_FIX_TYPE_3D_FIX
        assert ground.command(mavlink.MAV_CMD_GET_HOME_POSITION) == ACCEPTED
        ground.mode(GUIDED)
        assert ground.command(*ARM) == FAILED
        assert "PreArm: Need Position Estimate" in ground.texts()
        assert not [message for message in ground.heard if message.get_type() == "HOME_POSITION"]
        home = ground.next("HOME_POSITION")  # it tells by itself
        assert (home.latitude, home.longitude, home.altitude) == (LATITUDE, LONGITUDE, 440_000)
        simulator.autopilot.vehicle.position[:] = [0.0, 30.0, 0.0]
        assert ground.command(*ARM) == ACCEPTED
        moved = [message for message in ground.heard if message.get_type() == "HOME_POSITION"][-1]
        assert moved.latitude == pytest.approx(LATITUDE + 2_698, abs=5)


def test_it_arms_in_some_modes_only_and_takes_all_of_them(flown: Any) -> None:
    with flown() as (_simulator, ground):
        for mode, arms in (
            (RTL, False), (AUTO, False), (BRAKE, False), (LAND, False),
            (STABILIZE, True), (ALT_HOLD, True), (LOITER, True), (POSHOLD, True), (GUIDED, True),
        ):  # fmt: skip
            assert ground.mode(mode) == ACCEPTED
            assert ground.command(*ARM) == (ACCEPTED if arms else FAILED), mode
            if arms:
                assert ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == ACCEPTED
        assert [text for text in ground.texts() if "not armable" in text] == [
            f"Arm: {name} mode not armable" for name in ("RTL", "AUTO", "BRAKE", "LAND")
        ]
        assert ground.mode(99) == FAILED
        assert ground.texts()[-1] == "No such mode 99"
        ground.link.mav.set_mode_send(1, 1, LOITER)  # the older message
        ground.next("HEARTBEAT", lambda message: message.custom_mode == LOITER)


def test_a_mission_begins_with_a_takeoff_or_not_at_all(flown: Any) -> None:
    with flown() as (_simulator, ground):
        ground.mode(GUIDED)
        assert ground.command(*ARM) == ACCEPTED
        assert ground.mode(AUTO) == FAILED
        assert ground.upload([HOME_ITEM, NORTH]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == FAILED
        assert "Auto: Missing Takeoff Cmd" in ground.texts()
        assert ground.texts()[-1] == "Mode change to AUTO failed: init failed"


def test_missions_fences_and_rally_points_are_lists_of_their_own(flown: Any) -> None:
    corner = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    fence = [
        item(corner, LATITUDE + x, LONGITUDE + y, param1=4.0, frame=0)
        for x, y in ((-9_000, -9_000), (9_000, -9_000), (9_000, 9_000), (-9_000, 9_000))
    ]
    rally = [item(mavlink.MAV_CMD_NAV_RALLY_POINT, LATITUDE, LONGITUDE, 20.0)]
    with flown() as (simulator, ground):
        for kind, items in ((0, MISSION), (1, fence), (2, rally)):
            assert ground.upload(items, kind) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.upload([NORTH], 1) == mavlink.MAV_MISSION_UNSUPPORTED  # no fence
        assert [len(ground.download(kind)) for kind in (0, 1, 2)] == [5, 4, 1]
        assert [(each.command, each.x, each.y, each.param1) for each in ground.download(1)] == [
            (corner, each["x"], each["y"], 4.0) for each in fence
        ]
        ground.mav.mission_clear_all_send(1, 1, 1)
        assert ground.next("MISSION_ACK").mission_type == 1
        assert [len(ground.download(kind)) for kind in (0, 1, 2)] == [5, 0, 1]
        assert len(simulator.autopilot.mission) == 5
        ground.mav.mission_request_list_send(1, 77, 0)  # a component that it does not have
        ground.mav.mission_clear_all_send(1, 77, 0)
        ground.listen(0.3)
        assert len(simulator.autopilot.mission) == 5


def test_items_are_read_back_as_arducopter_keeps_them(flown: Any) -> None:
    pitched = item(mavlink.MAV_CMD_DO_MOUNT_CONTROL, param1=-6.1366, frame=2)
    sent = [
        {**HOME_ITEM, "x": 0},
        {**TAKEOFF, "z": 12.9599},
        {**NORTH, "param1": 2.7, "param2": 1.0, "param4": 330.0, "z": -12.349},
        {**WAIT, "param4": 330.0},
        pitched,
    ]
    with flown() as (_simulator, ground):
        assert ground.upload(sent) == mavlink.MAV_MISSION_ACCEPTED
        home, takeoff, north, wait, mount = ground.download()
        assert (home.x, home.y, home.z) == (LATITUDE, LONGITUDE, 440.0)  # its own
        assert takeoff.z == pytest.approx(12.95)
        assert (north.param1, north.param2, north.param4) == (2.0, 0.0, 0.0)
        assert north.z == pytest.approx(-12.34)
        assert (wait.param1, wait.param3, wait.param4) == (2_000.0, 1.0, 1.0)
        assert (mount.frame, mount.z) == (0, 2.0)
        assert mount.param1 == pytest.approx(-6.1366)
        ground.mav.mission_request_send(1, 1, 2)  # not in whole numbers
        assert ground.next("MISSION_ITEM").x == pytest.approx((LATITUDE + 3_000) * 1e-7, abs=1e-5)


def test_some_items_are_written_in_the_place_of_others(flown: Any) -> None:
    with flown() as (_simulator, ground):
        ground.upload(MISSION)
        ground.mav.mission_write_partial_list_send(1, 1, 2, 3)
        for number, z in ((2, 30.0), (3, 31.0)):
            assert ground.next("MISSION_REQUEST").seq == number
            ground.send_item(number, {**NORTH, "z": z})
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
        assert [each.z for each in ground.download()][1:4] == pytest.approx([10.0, 30.0, 31.0])
        ground.mav.mission_write_partial_list_send(1, 1, 5, 5)  # one more, at the end
        assert ground.next("MISSION_REQUEST").seq == 5
        ground.send_item(5, NORTH)
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_ACCEPTED
        assert len(ground.download()) == 6
        ground.mav.mission_write_partial_list_send(1, 1, 7, 9)
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_ERROR


def test_a_request_without_answer_is_repeated_and_given_up(flown: Any) -> None:
    with flown() as (_simulator, ground):
        ground.mav.mission_count_send(1, 1, 3)
        seen = [ground.next("MISSION_REQUEST").seq for _ in range(3)]
        assert seen == [0, 0, 0]
        ground.send_item(1, NORTH)
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_INVALID_SEQUENCE
        ground.mav.mission_request_list_send(1, 1)
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_DENIED
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_OPERATION_CANCELLED
        assert "Mission upload timeout" in ground.texts()


def fly(ground: Station, items: list[dict[str, Any]], until: int) -> None:
    """Fly a mission until an item is the current one."""
    assert ground.upload(items) == mavlink.MAV_MISSION_ACCEPTED
    ground.mode(GUIDED)
    assert ground.command(*ARM) == ACCEPTED
    assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
    ground.next("MISSION_CURRENT", lambda message: message.seq == until, 60.0)


def test_an_upload_over_the_item_that_is_flown_begins_it_again(flown: Any) -> None:
    with flown() as (_simulator, ground):
        fly(ground, MISSION, 3)
        ground.upload([*MISSION[:3], {**WAIT, "z": 20.0}, RETURN])
        assert "Auto mission changed, restarted command" in ground.texts()
        ground.mav.mission_clear_all_send(1, 1, 0)
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_ERROR  # not while it is flown
        ground.upload([HOME_ITEM, TAKEOFF])
        assert ground.texts()[-2] == "Auto mission changed but failed to restart command"


def test_another_item_is_begun_without_leaving_the_mission(flown: Any) -> None:
    with flown() as (simulator, ground):
        fly(ground, [*MISSION, {**NORTH, "z": 25.0}, WAIT, RETURN], 3)
        assert ground.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 99.0) == DENIED
        assert ground.command(mavlink.MAV_CMD_DO_SET_MISSION_CURRENT, 5.0) == ACCEPTED
        ground.until_text("Reached command #5")
        assert simulator.autopilot.vehicle.position[2] == pytest.approx(25.0, abs=1.5)
        ground.mav.mission_set_current_send(1, 1, 2)
        assert ground.next("MISSION_CURRENT", lambda message: message.seq == 2).mission_mode == 1
        assert ground.next("HEARTBEAT", lambda each: each.get_srcComponent() == 1).custom_mode == AUTO


def test_what_is_left_beside_an_item_that_is_done_is_passed_over(flown: Any) -> None:
    photograph = item(mavlink.MAV_CMD_DO_DIGICAM_CONTROL, x=1, frame=2)
    turn = item(mavlink.MAV_CMD_CONDITION_YAW, param1=180.0, frame=2)
    short = item(mavlink.MAV_CMD_NAV_DELAY, param1=0.0, param2=-1.0, param3=-1.0, param4=-1.0, frame=2)
    with flown() as (simulator, ground):
        fly(ground, [HOME_ITEM, TAKEOFF, NORTH, turn, photograph, short, WAIT, RETURN], 6)
        ground.listen(0.3)
        assert list(simulator.folder.glob("*.jpg")) == []  # the wait was over before it had turned


def test_guided_mode_takes_off_and_flies_to_positions(flown: Any) -> None:
    with flown() as (simulator, ground):
        vehicle = simulator.autopilot.vehicle
        takeoff = (mavlink.MAV_CMD_NAV_TAKEOFF, 0, 0, 0, 0, 0, 0, 10.0)
        assert ground.command(*takeoff) == FAILED  # not armed, not guided
        ground.mode(GUIDED)
        assert ground.command(*ARM) == ACCEPTED
        assert ground.command(*takeoff) == ACCEPTED
        until(lambda: vehicle.position[2] > 9.5)
        relative = mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT
        ground.mav.set_position_target_global_int_send(
            0, 1, 1, relative, 0b1111_1111_1000, LATITUDE + 2_000, LONGITUDE, 15.0, *[0.0] * 8
        )
        until(lambda: math.dist(vehicle.position, (0.0, 22.2, 15.0)) < 1.0)
        ground.mode(LOITER)
        reposition = (
            mavlink.MAV_CMD_DO_REPOSITION,
            0,
            0,
            -1.0,
            0.0,
            0.0,
            math.nan,
            LATITUDE,
            LONGITUDE,
            12.0,
        )
        ground.mav.command_int_send(1, 1, relative, *reposition)
        assert ground.next("COMMAND_ACK").result == FAILED  # not guided
        reposition = (
            mavlink.MAV_CMD_DO_REPOSITION,
            0,
            0,
            -1.0,
            1.0,
            0.0,
            math.nan,
            LATITUDE,
            LONGITUDE,
            12.0,
        )
        ground.mav.command_int_send(1, 1, relative, *reposition)
        assert ground.next("COMMAND_ACK").result == ACCEPTED
        until(lambda: math.dist(vehicle.position, (0.0, 0.0, 12.0)) < 1.0)
        assert ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 0.0) == FAILED  # in the air
        assert ground.command(mavlink.MAV_CMD_NAV_LAND) == ACCEPTED
        ground.until_text("Disarming motors")


def test_the_ground_station_of_the_failsafe_is_one_of_several(flown: Any) -> None:
    with flown(speed_up=5.0) as (_simulator, ground):
        for name, value in ((b"FS_GCS_ENABLE", 1.0), (b"SYSID_MYGCS", 252.0), (b"FS_GCS_TIMEOUT", 1.0)):
            ground.mav.param_set_send(1, 1, name, value, mavlink.MAV_PARAM_TYPE_INT8)
        fly(ground, MISSION, 2)
        for _ in range(15):  # another one's heartbeats do not count, and 252's were never heard
            ground.beat()
            ground.listen(0.1)
        assert "GCS Failsafe" not in ground.texts()
        ground.mav.srcSystem = 252
        ground.beat()
        ground.mav.srcSystem = 254
        ground.until_text("GCS Failsafe")
        ground.next("HEARTBEAT", lambda message: message.custom_mode == RTL)
        ground.mav.srcSystem = 252
        ground.beat()
        ground.until_text("GCS Failsafe Cleared")


def test_a_fence_turns_it_back(flown: Any) -> None:
    with flown() as (_simulator, ground):
        ground.mav.param_set_send(1, 1, b"FENCE_RADIUS", 20.0, mavlink.MAV_PARAM_TYPE_REAL32)
        ground.mav.param_set_send(1, 1, b"FENCE_ENABLE", 1.0, mavlink.MAV_PARAM_TYPE_INT8)
        fly(ground, MISSION, 2)
        ground.until_text("Fence breach cleared")
        texts = ground.texts()
        at = texts.index("Circle fence breached")
        assert texts[at + 1] == "Manual recovery started"
        assert ground.next("HEARTBEAT", lambda each: each.get_srcComponent() == 1).custom_mode == RTL


def test_a_polygon_is_a_fence_too(flown: Any) -> None:
    corner = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_EXCLUSION
    north = [
        item(corner, LATITUDE + x, LONGITUDE + y, param1=4.0, frame=0)
        for x, y in ((2_000, -9_000), (9_000, -9_000), (9_000, 9_000), (2_000, 9_000))
    ]
    with flown() as (_simulator, ground):
        assert ground.upload(north, 1) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_DO_FENCE_ENABLE, 1.0) == ACCEPTED
        fly(ground, MISSION, 2)
        ground.until_text("Polygon fence breached")
        ground.next("HEARTBEAT", lambda message: message.custom_mode == RTL)


def test_a_low_battery_is_acted_on_once(flown: Any) -> None:
    with flown() as (simulator, ground):
        fly(ground, MISSION, 2)
        simulator.autopilot.vehicle.battery = 0.149
        ground.until_text("Battery Failsafe")
        assert any(text.startswith("Battery 1 is low 12.60V used 42") for text in ground.texts())
        ground.next("HEARTBEAT", lambda message: message.custom_mode == RTL)
        assert ground.mode(LOITER) == ACCEPTED  # the pilot wants it otherwise
        ground.listen(0.3)
        assert simulator.autopilot.mode.name == "LOITER"
        simulator.autopilot.vehicle.battery = 0.029
        ground.next("HEARTBEAT", lambda message: message.custom_mode == LAND)
        assert ground.next("HEARTBEAT", lambda message: message.get_srcComponent() == 1).system_status == (
            mavlink.MAV_STATE_CRITICAL
        )


def test_without_a_position_it_lands(flown: Any) -> None:
    with flown() as (simulator, ground):
        fly(ground, MISSION, 2)
        simulator.autopilot.faults.no_fix = True
        ground.until_text("EKF Failsafe: changed to LAND Mode")
        assert "EKF variance" in ground.texts()
        assert ground.mode(RTL) == FAILED
        assert ground.texts()[-1] == "Mode change to RTL failed: requires position"


def test_several_stations_hear_each_other(tmp_path: Path) -> None:
    with closing(Simulator(tmp_path, 0, links=["tcpin:127.0.0.1:0", "udpin:127.0.0.1:0"])) as simulator:
        stations = [Station(url, 200 + number) for number, url in enumerate(simulator.autopilot.urls)]
        third = Station(simulator.url, 202)
        third.beat()
        for station in stations:
            assert station.next("HEARTBEAT", lambda message: message.get_srcSystem() == 202)
        stations[0].mode(GUIDED)
        third.next("HEARTBEAT", lambda message: message.custom_mode == GUIDED)
        third.listen(0.2)
        assert not [message for message in third.heard if message.get_type() == "COMMAND_ACK"]
        for station in (*stations, third):
            station.link.close()


def test_it_sends_to_where_it_is_told(tmp_path: Path) -> None:
    with closing(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    with closing(Simulator(tmp_path, 0, links=[f"udpout:127.0.0.1:{port}"])) as simulator:
        assert simulator.url == f"udpin:127.0.0.1:{port}"
        station = Station(simulator.url)
        assert station.mode(GUIDED) == ACCEPTED
        station.link.close()


NUMBERS = (math.nan, math.inf, -math.inf, 3e38, -1.0, 0.0)


@pytest.mark.parametrize("firmware", ["ardupilot", "px4"])
def test_no_number_kills_it(flown: Any, firmware: str) -> None:
    """Every message that stations may send, with numbers that are none."""
    with flown(firmware=firmware) as (simulator, ground):
        ground.upload(MISSION)
        for number in NUMBERS:
            for command in sorted(mavlink.enums["MAV_CMD"]):
                if command < 50_000:
                    ground.mav.command_long_send(1, 0, command, 0, *[number] * 7)
                    ground.mav.command_int_send(
                        1, 0, 3, command, 0, 0, *[number] * 4, -(2**31), 2**31 - 1, number
                    )
            for count in (1, 2):
                ground.mav.mission_count_send(1, 1, count, 0)
                for command in (16, 19, 22, 115, 203, 205, 2000):
                    ground.mav.mission_item_int_send(1, 1, 0, 3, command, 0, 1, *[number] * 4, 0, 0, number)
                    ground.mav.mission_item_send(1, 1, 1, 3, command, 0, 1, *[number] * 7)
            ground.mav.param_set_send(1, 1, b"WPNAV_SPEED", number, 9)
            ground.mav.param_set_send(1, 1, b"RTL_ALT", number, 6)
            ground.mav.set_position_target_global_int_send(0, 1, 1, 6, 0, 0, 0, *[number] * 9)
            ground.listen(0.05)
        simulator.autopilot.vehicle.position[2] = 5.0
        ground.command(mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)
        ground.listen(0.5)
        assert simulator.alive
        assert ground.next("HEARTBEAT") is not None
        assert all(map(math.isfinite, simulator.autopilot.vehicle.position))


def until(condition: Any) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)
