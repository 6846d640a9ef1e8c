"""With PX4's firmware the simulated copter behaves as PX4's sources say; each test names what it is from."""

import math
import time
from collections.abc import Callable
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from fvs_engine.lab.simulate.mavlink.flight_state import Faults, Mode

pytestmark = pytest.mark.process

LATITUDE, LONGITUDE = 473_769_000, 85_417_000
ACCEPTED, DENIED, UNSUPPORTED = (
    mavlink.MAV_RESULT_ACCEPTED,
    mavlink.MAV_RESULT_DENIED,
    mavlink.MAV_RESULT_UNSUPPORTED,
)
AUTO_LOITER, AUTO_RTL = 4 << 16 | 3 << 24, 4 << 16 | 5 << 24
ARM = (mavlink.MAV_CMD_COMPONENT_ARM_DISARM, 1.0)


def item(command: int, x: int = 0, y: int = 0, z: float = 0.0, **more: Any) -> dict[str, Any]:
    return {"command": command, "x": x, "y": y, "z": z, **more}


TAKEOFF = item(mavlink.MAV_CMD_NAV_TAKEOFF, LATITUDE, LONGITUDE, 10.0, param4=math.nan)
SHUTTER = item(mavlink.MAV_CMD_IMAGE_START_CAPTURE, param3=1.0, param4=1.0, frame=2)
RETURN = item(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH, frame=2)


def view(**more: Any) -> dict[str, Any]:
    """A waypoint where it is, at which it turns around."""
    return item(mavlink.MAV_CMD_NAV_WAYPOINT, LATITUDE, LONGITUDE, 10.0, param4=180.0, **more)


@pytest.mark.parametrize(
    ("way", "parameters", "most_deg"),
    [
        ([view()], {}, 12.0),
        ([view(param1=2.0)], {}, 12.0),
        ([view(), item(mavlink.MAV_CMD_NAV_DELAY, param1=1.0, frame=2)], {}, 0.1),
        ([view()], {"MIS_YAW_TMT": 1.0}, 180.0),
    ],
    ids=[
        "at once",
        "the hold is counted while it turns",
        "a delay begins after the turn",
        "it does not wait",
    ],
)
def test_it_goes_on_when_it_has_nearly_turned(
    flown: Any, way: list[dict[str, Any]], parameters: dict[str, float], most_deg: float
) -> None:
    """``mission_block.cpp``: in ``MIS_YAW_ERR``, unless ``MIS_YAW_TMT`` is set; a hold counts meanwhile."""
    with flown(firmware="px4", speed_up=5.0) as (simulator, ground):
        for name, value in parameters.items():
            ground.mav.param_set_send(1, 1, name.encode(), value, mavlink.MAV_PARAM_TYPE_REAL32)
        assert ground.upload([*way, SHUTTER, RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(*ARM) == ACCEPTED
        simulator.autopilot.vehicle.position[2] = 10.0
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        taken = ground.next("CAMERA_IMAGE_CAPTURED")
        off_deg = abs(180.0 - yaw_deg(taken.q))
        assert most_deg / 2.0 - 0.05 <= off_deg <= most_deg + 0.1


def test_commands_are_refused_in_its_words(flown: Any) -> None:
    """``Commander.cpp``, ``handle_command``; ``navigator_main.cpp`` for ``MISSION_START`` from an item."""
    with flown(firmware="px4") as (simulator, ground):
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == DENIED
        assert "Mission start denied! No valid mission" in ground.texts()
        for unknown in (
            mavlink.MAV_CMD_CONDITION_YAW,
            mavlink.MAV_CMD_DO_PAUSE_CONTINUE,
            mavlink.MAV_CMD_IMAGE_START_CAPTURE,
            mavlink.MAV_CMD_DO_REPOSITION,  # without the flag that changes the mode
        ):
            assert ground.command(unknown, 0.0, 0.0, 1.0) == UNSUPPORTED
        assert ground.upload([TAKEOFF, view(), SHUTTER, RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START, 4.0) == DENIED  # it has no such item
        assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 4.0) == ACCEPTED
        assert not simulator.autopilot._state.armed  # the mode alone does not arm
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        assert simulator.autopilot._state.armed


def test_nobody_outside_forces_it_to_arm(flown: Any) -> None:
    """``Commander.cpp``: 21196 disarms in the air, but the checks before arming run."""
    with flown(firmware="px4", faults=Faults(no_fix=True)) as (_simulator, ground):
        assert ground.command(*ARM, 21_196.0) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED


def test_at_the_end_of_a_mission_it_stays_in_its_mode(flown: Any) -> None:
    """``mission_base.cpp``: ``advance_mission``, ``setEndOfMissionItems``. Another mission begins at once."""
    with flown(firmware="px4") as (simulator, ground):
        assert ground.upload([TAKEOFF, view()]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        ground.until_text("Mission finished, loitering")
        current = ground.next("MISSION_CURRENT", lambda message: message.mission_state == 5)
        assert (current.seq, current.total, current.mission_mode) == (1, 2, 1)
        assert ground.upload([view(), SHUTTER]) == mavlink.MAV_MISSION_ACCEPTED
        ground.next("CAMERA_IMAGE_CAPTURED")
        assert simulator.autopilot.mode is Mode.MISSION


def test_the_gimbal_levels_in_a_pause_and_turns_back_after_it(flown: Any) -> None:
    """``mission_base.cpp``: ``on_inactivation`` makes it neutral, ``on_activation`` does its items again."""
    tilt = item(mavlink.MAV_CMD_DO_MOUNT_CONTROL, param1=-40.0, z=2.0, frame=2)
    with flown(firmware="px4") as (simulator, ground):
        assert ground.upload([TAKEOFF, tilt, view(param1=500.0), RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        until(lambda: simulator.autopilot.vehicle.pitch_deg == pytest.approx(-40.0))
        assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 3.0) == ACCEPTED
        until(lambda: simulator.autopilot.vehicle.pitch_deg == pytest.approx(0.0))
        assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 4.0) == ACCEPTED
        until(lambda: simulator.autopilot.vehicle.pitch_deg == pytest.approx(-40.0))


def test_missions_photograph_by_its_camera_trigger(flown: Any) -> None:
    """``navigator_main.cpp``: one photograph becomes ``DO_DIGICAM_CONTROL``. ``CameraFeedback.cpp``."""
    with flown(firmware="px4") as (simulator, ground):
        assert ground.upload([TAKEOFF, SHUTTER, RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        own = ground.next("CAMERA_IMAGE_CAPTURED", lambda message: message.get_srcComponent() == 1)
        assert (own.image_index, own.capture_result, own.relative_alt, own.file_url) == (0, 1, -1_000, "")
        until(lambda: not simulator.autopilot._state.armed)
        simulator.autopilot._pilot._board.parameters._values["TRIG_MODE"] = 0.0
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        ground.next("HEARTBEAT", lambda message: message.custom_mode == AUTO_RTL)  # it returns
        assert len(list(simulator.folder.glob("*.jpg"))) == 1


@pytest.mark.parametrize(
    ("mission", "said"),
    [
        ([{**TAKEOFF, "z": 1.5}, view(), RETURN], "Mission rejected: Takeoff altitude too low!"),
        ([view(), TAKEOFF, RETURN], "Mission rejected: takeoff not first waypoint item"),
        ([item(mavlink.MAV_CMD_NAV_LAND), RETURN], "Mission rejected: starts with landing"),
        ([TAKEOFF, {**view(), "x": LATITUDE + 20_000}, RETURN], "Geofence violation for waypoint 2"),
    ],
)
def test_it_takes_missions_that_it_does_not_fly(flown: Any, mission: list[dict[str, Any]], said: str) -> None:
    """``FeasibilityChecker.cpp`` checks a mission when ``mavlink_mission.cpp`` has accepted it."""
    corner = mavlink.MAV_CMD_NAV_FENCE_POLYGON_VERTEX_INCLUSION
    fence = [
        item(corner, LATITUDE + x, LONGITUDE + y, param1=4.0, frame=0)
        for x, y in ((-9_000, -9_000), (9_000, -9_000), (9_000, 9_000), (-9_000, 9_000))
    ]
    with flown(firmware="px4") as (simulator, ground):
        assert ground.upload(fence, 1) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.upload(mission) == mavlink.MAV_MISSION_ACCEPTED
        ground.until_text(said)
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == DENIED
        assert not simulator.autopilot._state.armed


def test_it_returns_from_a_mission_that_it_does_not_fly(flown: Any) -> None:
    """``failsafe.cpp``, ``checkModeFallback``: at once, without holding first."""
    with flown(firmware="px4") as (simulator, ground):
        assert ground.upload([TAKEOFF, view(param1=500.0), RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        until(lambda: simulator.autopilot.vehicle.position[2] > 8.0)
        assert ground.upload([view(), TAKEOFF, RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        beat = ground.next("HEARTBEAT", lambda message: message.custom_mode == AUTO_RTL)
        assert beat.system_status == mavlink.MAV_STATE_CRITICAL
        assert ground.texts()[-2:] == ["No valid mission available, loitering", "Failsafe activated"]
        until(lambda: not simulator.autopilot._state.armed)


def test_it_holds_before_its_failsafe_returns(flown: Any) -> None:
    """``framework.cpp``, ``getSelectedAction``: for ``COM_FAIL_ACT_T``; who changes the mode takes over."""
    with flown(firmware="px4", speed_up=5.0) as (simulator, ground):
        assert ground.upload([TAKEOFF, view(param1=500.0), RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        until(lambda: simulator.autopilot.vehicle.position[2] > 8.0)
        simulator.autopilot.vehicle.battery = 0.1
        beat = ground.next("HEARTBEAT", lambda message: message.custom_mode == AUTO_LOITER)
        assert beat.system_status == mavlink.MAV_STATE_CRITICAL
        ground.until_text("Failsafe activated, entering Hold for 5 seconds")
        ground.next("HEARTBEAT", lambda message: message.custom_mode == AUTO_RTL)
        assert ground.texts()[-1] == "Failsafe activated"
        assert ground.command(mavlink.MAV_CMD_DO_SET_MODE, 1.0, 4.0, 3.0) == ACCEPTED
        ground.next("HEARTBEAT", lambda message: message.custom_mode == AUTO_LOITER)
        ground.listen(2.0)
        assert simulator.autopilot.mode is Mode.LOITER


def test_a_mission_is_begun_where_it_is_marked(flown: Any) -> None:
    """``handle_mission_item_both``: without a mark at the same number. The same mission changes nothing."""
    waits = view(param1=5_000.0)
    with flown(firmware="px4") as (simulator, ground):
        assert ground.upload([TAKEOFF, waits, RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        ground.next("MISSION_CURRENT", lambda message: message.seq == 1)
        mission = simulator.autopilot._pilot.mission
        for items, number in (
            ([TAKEOFF, waits, SHUTTER, RETURN], 1),
            ([{**TAKEOFF, "z": 30.0, "current": 1}, waits, RETURN], 0),
        ):
            assert ground.upload(items) == mavlink.MAV_MISSION_ACCEPTED
            until(lambda number=number: mission.current == number)  # type: ignore[misc]
        until(lambda: mission.current == 1)  # messages of before may still come
        assert ground.upload([{**TAKEOFF, "z": 30.0, "current": 1}, waits, RETURN]) == 0
        assert mission.current == 1


def test_items_are_sent_in_order_to_who_asks_for_the_list(flown: Any) -> None:
    """``handle_mission_request_both``, ``handle_mission_count``: it goes on with one station at a time."""
    with flown(firmware="px4") as (_simulator, ground):
        assert ground.upload([TAKEOFF, view(), RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        ground.mav.mission_request_int_send(1, 1, 0, 0)  # without the list
        ground.mav.mission_write_partial_list_send(1, 1, 0, 1, 0)  # which it does not know
        assert not {"MISSION_ITEM_INT", "MISSION_ACK"} & {each.get_type() for each in ground.listen(0.3)}
        assert [each.command for each in ground.download()] == [22, 16, 20]
        ground.mav.mission_request_list_send(1, 1, 0)
        assert ground.next("MISSION_COUNT").count == 3
        ground.mav.mission_request_int_send(1, 1, 2, 0)
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_ERROR
        ground.mav.mission_count_send(1, 1, 2, 0)
        ground.next("MISSION_REQUEST_INT")
        ground.mav.srcComponent = 7
        ground.mav.mission_count_send(1, 1, 2, 0)
        assert ground.next("MISSION_ACK").type == mavlink.MAV_MISSION_ERROR
        ground.until_text("Operation timeout")  # and no answer


def test_a_lost_ground_station_ends_missions_too(flown: Any) -> None:
    """``NAV_DLL_ACT``; ``rcAndDataLinkCheck.cpp``: without a station it does not arm then."""
    with flown(firmware="px4") as (simulator, ground):
        values = simulator.autopilot._pilot._board.parameters._values
        values |= {"NAV_DLL_ACT": 2.0, "COM_DL_LOSS_T": 1.0}
        assert ground.upload([TAKEOFF, view(param1=5_000.0), RETURN]) == mavlink.MAV_MISSION_ACCEPTED
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == mavlink.MAV_RESULT_TEMPORARILY_REJECTED
        assert ground.texts()[-1] == "Preflight Fail: No connection to the GCS"
        ground.beat()
        until(lambda: not simulator.autopilot._state.station_lost)
        assert ground.command(mavlink.MAV_CMD_MISSION_START) == ACCEPTED
        ground.next("HEARTBEAT", lambda message: message.custom_mode == AUTO_RTL)


def yaw_deg(quaternion: list[float]) -> float:
    w, x, y, z = quaternion
    return math.degrees(math.atan2(2.0 * (w * z + x * y), 1.0 - 2.0 * (y * y + z * z))) % 360.0


def until(condition: Callable[[], bool]) -> None:
    end = time.monotonic() + 30.0
    while not condition():
        assert time.monotonic() < end
        time.sleep(0.02)
