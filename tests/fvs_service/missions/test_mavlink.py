"""MAVLink missions, read by pymavlink and sent as MISSION_ITEM_INT."""

import json
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pytest
from pymavlink import mavwp
from pymavlink.dialects.v20 import ardupilotmega as mavlink

MOST_DEGREES_E7 = 1_800_000_000


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "mission.waypoints"


def _loaded(content: bytes, file: Path) -> list[Any]:
    """The items that pymavlink loads from a waypoint file."""
    file.write_bytes(content)
    loader = mavwp.MAVWPLoader()
    count = loader.load(str(file))
    return [loader.wp(number) for number in range(count)]


def _sent(items: Sequence[Any]) -> Iterator[Any]:
    """The items as a vehicle receives them: packed as MISSION_ITEM_INT, and parsed."""
    sender, receiver = mavlink.MAVLink(None, 255, 190), mavlink.MAVLink(None, 1, 1)
    for item in items:
        scale = 1e7 if item.frame != mavlink.MAV_FRAME_MISSION else 1.0
        message = mavlink.MAVLink_mission_item_int_message(
            *(1, 1, item.seq, item.frame, item.command, item.current, item.autocontinue),
            *(item.param1, item.param2, item.param3, item.param4),
            *(round(item.x * scale), round(item.y * scale), item.z),
        )
        assert abs(message.x) <= MOST_DEGREES_E7
        assert abs(message.y) <= MOST_DEGREES_E7
        received = receiver.parse_buffer(message.pack(sender))
        assert received is not None
        assert len(received) == 1
        yield received[0]


def _views(items: Sequence[Any], px4: bool) -> Iterator[tuple[tuple[float, float, float], float, float]]:
    """Position, yaw and gimbal pitch of each photograph in received items."""
    pitch = yaw = place = None
    photo = mavlink.MAV_CMD_IMAGE_START_CAPTURE if px4 else mavlink.MAV_CMD_DO_DIGICAM_CONTROL
    for item in items:
        if item.command == mavlink.MAV_CMD_DO_MOUNT_CONTROL:
            pitch = item.param1
            assert item.z == mavlink.MAV_MOUNT_MODE_MAVLINK_TARGETING
        elif item.command == mavlink.MAV_CMD_NAV_WAYPOINT:
            place, yaw = (item.x / 1e7, item.y / 1e7, item.z), item.param4
        elif item.command == mavlink.MAV_CMD_CONDITION_YAW:
            assert item.param1 == yaw
            assert item.param4 == 0  # not relative
        elif item.command == photo:
            assert place is not None
            assert yaw is not None
            assert pitch is not None
            yield place, yaw, pitch


def test_pymavlink_loads_and_encodes_many_missions(flights: Any, errors: Any, file: Path) -> None:
    for number, flight in enumerate(flights):
        autopilot = "px4" if number % 2 else "ardupilot"
        items = _loaded(flight.write(format="qgc-wpl", autopilot=autopilot), file)
        assert [item.seq for item in items] == list(range(len(items)))
        assert [item.current for item in items] == [1] + [0] * (len(items) - 1)
        received = list(_sent(items[1:]))
        found = list(_views(received, autopilot == "px4"))
        assert len(found) == len(flight.views)
        for view, (place, yaw, pitch) in zip(flight.views, found, strict=True):
            altitude = place[2] - flight.to_takeoff_m
            errors.add(flight, view, (*place[:2], altitude), yaw, pitch)
        frames = {item.frame for item in received}
        assert frames == {mavlink.MAV_FRAME_MISSION, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT}
        assert received[0].command == mavlink.MAV_CMD_NAV_TAKEOFF
        assert math.isnan(received[0].param4) == (autopilot == "px4")
        assert received[-1].command == mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH
        numbers = [getattr(item, f"param{place}") for item in received[1:] for place in range(1, 5)]
        assert all(map(math.isfinite, numbers))
    errors.check("QGC WPL 110")


def test_plans_have_the_items_of_waypoint_files(flights: Any, errors: Any, file: Path) -> None:
    for number, flight in enumerate(flights):
        autopilot = "px4" if number % 2 else "ardupilot"
        plan = json.loads(flight.write(format="qgc-plan", autopilot=autopilot))
        items = [_item_of(item) for item in plan["mission"]["items"]]
        received = list(_sent(items))
        for view, (place, yaw, pitch) in zip(flight.views, _views(received, autopilot == "px4"), strict=True):
            errors.add(flight, view, (*place[:2], place[2] - flight.to_takeoff_m), yaw, pitch)
        if number >= 20:
            continue
        loaded = _loaded(flight.write(format="qgc-wpl", autopilot=autopilot), file)[1:]
        assert [(item.command, item.frame) for item in loaded] == [
            (item.command, item.frame) for item in items
        ]
    errors.check("QGroundControl plan")


def _item_of(item: dict[str, Any]) -> Any:
    """An item of a plan as MAVLink's MISSION_ITEM: null is NaN."""
    parameters = [math.nan if value is None else value for value in item["params"]]
    return mavlink.MAVLink_mission_item_message(
        *(1, 1, item["doJumpId"], item["frame"], item["command"], 0, item["autoContinue"]), *parameters
    )


def test_a_plan_has_the_structure_of_qgroundcontrol(flights: Any) -> None:
    fence = "46,7;46,8;47,8;47,7"
    flight = next(one for one in flights if one.origin.latitude_deg == 46.02)
    for autopilot, firmware in (
        ("ardupilot", mavlink.MAV_AUTOPILOT_ARDUPILOTMEGA),
        ("px4", mavlink.MAV_AUTOPILOT_PX4),
    ):
        plan = json.loads(flight.write(format="qgc-plan", autopilot=autopilot, geofence=fence, speed_m_s=7.0))
        assert {"fileType", "version", "groundStation", "mission", "geoFence", "rallyPoints"} == plan.keys()
        assert (plan["fileType"], plan["version"]) == ("Plan", 1)
        mission = plan["mission"]
        assert {
            *("version", "firmwareType", "vehicleType", "globalPlanAltitudeMode", "cruiseSpeed"),
            *("hoverSpeed", "plannedHomePosition", "items"),
        } == mission.keys()
        assert mission["version"] == 2
        assert mission["firmwareType"] == firmware == {"ardupilot": 3, "px4": 12}[autopilot]
        assert mission["vehicleType"] == mavlink.MAV_TYPE_QUADROTOR
        assert mission["hoverSpeed"] == 7.0
        assert len(mission["plannedHomePosition"]) == 3
        for number, item in enumerate(mission["items"], start=1):
            assert item["type"] == "SimpleItem"
            assert item["doJumpId"] == number
            assert item["command"] in mavlink.enums["MAV_CMD"]
            assert item["frame"] in mavlink.enums["MAV_FRAME"]
            assert len(item["params"]) == 7
            if item["frame"] != mavlink.MAV_FRAME_MISSION:
                assert item["Altitude"] == item["params"][6]
                assert item["AltitudeMode"] == mission["globalPlanAltitudeMode"] == 1  # above home
        (polygon,) = plan["geoFence"]["polygons"]
        assert plan["geoFence"]["version"] == plan["rallyPoints"]["version"] == 2
        assert polygon == {
            "version": 1,
            "inclusion": True,
            "polygon": [[46.0, 7.0], [46.0, 8.0], [47.0, 8.0], [47.0, 7.0]],
        }


def test_altitudes_above_sea_level_have_the_global_frame(flights: Any, file: Path) -> None:
    flight = next(one for one in flights if one.origin.altitude_datum == "sea-level")
    content = flight.write(format="qgc-wpl", altitude_datum="sea-level")
    placed = [item for item in _loaded(content, file) if item.frame != mavlink.MAV_FRAME_MISSION]
    assert {item.frame for item in placed} == {mavlink.MAV_FRAME_GLOBAL}
    home = placed[0]
    assert (home.x, home.y) == (flight.origin.latitude_deg, flight.origin.longitude_deg)
    assert home.z == pytest.approx(flight.origin.altitude_m, abs=1e-6)
    assert all(item.z >= home.z - 1.0 for item in placed)
    plan = json.loads(flight.write(format="qgc-plan", altitude_datum="sea-level"))["mission"]
    assert plan["globalPlanAltitudeMode"] == 2
    assert plan["plannedHomePosition"][2] == flight.origin.altitude_m


def test_a_vehicle_in_the_air_does_not_take_off_and_may_stay_there(flights: Any, file: Path) -> None:
    items = _loaded(flights[0].write(format="qgc-wpl", takeoff=False, finish="hold"), file)
    commands = {item.command for item in items}
    assert mavlink.MAV_CMD_NAV_TAKEOFF not in commands
    assert mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH not in commands


def test_speed_hold_and_radius_are_in_the_items(flights: Any, file: Path) -> None:
    options = {"speed_m_s": 3.5, "hold_s": 2.5, "acceptance_radius_m": 0.75}
    for autopilot in ("ardupilot", "px4"):
        items = _loaded(flights[0].write(format="qgc-wpl", autopilot=autopilot, **options), file)[1:]
        (speed,) = [item for item in items if item.command == mavlink.MAV_CMD_DO_CHANGE_SPEED]
        assert (speed.param1, speed.param2) == (1.0, 3.5)
        waypoints = [item for item in items if item.command == mavlink.MAV_CMD_NAV_WAYPOINT]
        assert {item.param2 for item in waypoints} == {0.75}
        assert {item.param1 for item in waypoints} == {0.0}  # PX4 counts it while it turns
        delays = [item.param1 for item in items if item.command == mavlink.MAV_CMD_NAV_DELAY]
        assert set(delays) == {1.0, 2.5 if autopilot == "px4" else 6.5}


def test_px4_has_turned_before_the_photograph(flights: Any, file: Path) -> None:
    """It goes on within 12° of the yaw: a delay lasts until the turn has ended, also without a hold."""
    items = _loaded(flights[0].write(format="qgc-wpl", autopilot="px4", hold_s=0.0), file)
    captures = [n for n, item in enumerate(items) if item.command == mavlink.MAV_CMD_IMAGE_START_CAPTURE]
    assert captures
    for number in captures:
        turns, held = items[number - 2 : number]
        assert (turns.command, held.command) == (mavlink.MAV_CMD_NAV_WAYPOINT, mavlink.MAV_CMD_NAV_DELAY)
        assert held.param1 == 1.0


def test_a_copter_of_ardupilot_has_turned_before_the_photograph(flights: Any, file: Path) -> None:
    """ArduPilot drops what has not begun when a delay ends: the turn and the photograph have a delay each."""
    items = _loaded(flights[0].write(format="qgc-wpl", autopilot="ardupilot", hold_s=0.0), file)
    turns = [number for number, item in enumerate(items) if item.command == mavlink.MAV_CMD_CONDITION_YAW]
    assert turns
    for number in turns:
        turned, photograph, taken = items[number + 1 : number + 4]
        assert (turned.command, turned.param1) == (mavlink.MAV_CMD_NAV_DELAY, 4.0)
        assert photograph.command == mavlink.MAV_CMD_DO_DIGICAM_CONTROL
        assert (taken.command, taken.param1) == (mavlink.MAV_CMD_NAV_DELAY, 1.0)
