"""Mission items: waypoint files, the wait at the end, and surveys."""

import math

import pytest
from fvs_client.fly.dialects import ARDUPILOT, PX4
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.items import (
    Command,
    Frame,
    MissionItem,
    after,
    holding,
    read_waypoints,
    resumes_at,
)
from fvs_client.fly.survey import Survey

HOME = "0\t1\t0\t16\t0\t0\t0\t0\t47.5\t8.25\t412.5\t1"
VIEW = "1\t0\t3\t16\t4\t1\t0\t90\t47.50012345\t8.25\t20\t1"
RETURN = "2\t0\t2\t20\t0\t0\t0\t0\t0\t0\t0\t1"


def wpl(*lines: str) -> str:
    return "\r\n".join(["QGC WPL 110", *lines, ""])


def test_a_waypoint_file_is_read() -> None:
    home, view, back = read_waypoints(wpl(HOME, VIEW, RETURN))
    assert home == MissionItem(Command.WAYPOINT, Frame.GLOBAL, x=47.5, y=8.25, z=412.5)
    assert view == MissionItem(16, 3, (4.0, 1.0, 0.0, 90.0), 47.50012345, 8.25, 20.0)
    assert view.encoded == (475_001_234, 82_500_000)  # to the nearest 1e-7 degrees: a centimetre
    assert not back.placed


def test_parameters_of_commands_are_no_positions() -> None:
    trigger = MissionItem(Command.DIGICAM_CONTROL, Frame.MISSION, x=1.0)
    assert trigger.encoded == (1, 0)
    assert MissionItem(Command.WAYPOINT, Frame.RELATIVE, x=math.nan, y=8.0).encoded == (0, 80_000_000)


@pytest.mark.parametrize(
    ("text", "reason"),
    [("", "no mission"), ("QGC WPL 120\n" + HOME, "no mission"), (wpl(HOME, VIEW[:-4]), "Line 3"),
     (wpl(HOME.replace("412.5", "high")), "Line 2")],
)  # fmt: skip
def test_a_broken_file_is_refused(text: str, reason: str) -> None:
    with pytest.raises(VehicleError, match=reason):
        read_waypoints(text)


def test_a_mission_waits_at_its_last_view_and_then_ends_at_home() -> None:
    items = read_waypoints(wpl(HOME, VIEW, RETURN))
    for given in (items, items[:-1]):
        waiting = holding(given, 120.0)
        assert waiting[:2] == items[:2]
        assert waiting[2] == MissionItem(
            Command.LOITER_TIME, 3, (120.0, 0.0, 0.0, 90.0), 47.50012345, 8.25, 20.0
        )
        assert waiting[3] == MissionItem(Command.RETURN_TO_LAUNCH, Frame.MISSION)
        assert len(waiting) == 4
    with pytest.raises(VehicleError, match="no waypoint"):
        holding([], 120.0)


def test_a_survey_looks_at_the_middle_from_all_around() -> None:
    survey = Survey(60.0, 8.0, radius_m=100.0, height_m=50.0, target_height_m=10.0, count=4, start_deg=90.0)
    items = survey.items(ARDUPILOT)
    places = [item for item in items[1:] if item.command == Command.WAYPOINT]
    assert [item.parameters[3] for item in places] == pytest.approx([270.0, 0.0, 90.0, 180.0])
    north_m = [(item.x - 60.0) * 111_194.9 for item in places]
    east_m = [(item.y - 8.0) * 111_194.9 * 0.5 for item in places]
    assert north_m == pytest.approx([0.0, -100.0, 0.0, 100.0], abs=0.01)
    assert east_m == pytest.approx([100.0, 0.0, -100.0, 0.0], abs=0.01)
    pitches = [item.parameters[0] for item in items if item.command == Command.MOUNT_CONTROL]
    assert pitches == pytest.approx([math.degrees(math.atan2(-40.0, 100.0))] * 4)
    shutters = [number for number, item in enumerate(items) if item.command == Command.DIGICAM_CONTROL]
    assert len(shutters) == 4
    for number in shutters:  # the time of half a turn at ArduCopter's 60°/s, and to stand still
        assert [item.command for item in items[number - 2 : number]] == [Command.CONDITION_YAW, Command.DELAY]
        assert items[number - 1].parameters[0] >= 5.0
    assert (items[1].command, items[-1].command) == (Command.TAKEOFF, Command.RETURN_TO_LAUNCH)


def test_px4_turns_at_waypoints_and_starts_captures() -> None:
    items = Survey(60.0, 8.0, radius_m=100.0, height_m=50.0, count=3).items(PX4)
    assert math.isnan(items[1].parameters[3])  # the takeoff keeps its yaw
    waypoints = [item for item in items[1:] if item.command == Command.WAYPOINT]
    assert [item.parameters[3] for item in waypoints] == pytest.approx([180.0, 300.0, 60.0])
    captures = [item for item in items if item.command == Command.IMAGE_START_CAPTURE]
    before = [items[items.index(capture) - 1] for capture in captures]  # it stands still after the turn
    assert [(item.command, item.parameters[0]) for item in before] == [(Command.DELAY, 2.0)] * 3
    assert [item.parameters for item in captures] == [(0.0, 0.0, 1.0, float(n)) for n in (1, 2, 3)]
    assert not {item.command for item in items} & {Command.CONDITION_YAW, Command.DIGICAM_CONTROL}


def test_an_arc_has_a_photograph_at_either_end() -> None:
    items = Survey(0.0, 0.0, 10.0, 5.0, count=3, start_deg=-45.0, arc_deg=90.0).items(ARDUPILOT)
    yaws = [item.parameters[3] for item in items[1:] if item.command == Command.WAYPOINT]
    assert yaws == pytest.approx([135.0, 180.0, 225.0])


@pytest.mark.parametrize("wrong", [{"count": 2}, {"radius_m": 0.0}, {"height_m": -1.0}])
def test_a_survey_that_cannot_be_flown_is_refused(wrong: dict[str, float]) -> None:
    with pytest.raises(VehicleError, match="3 photographs"):
        Survey(**{"latitude_deg": 0.0, "longitude_deg": 0.0, "radius_m": 9.0, "height_m": 9.0, **wrong})  # type: ignore[arg-type]


@pytest.mark.parametrize("count", [3, 12])
def test_a_vehicle_whose_upload_ends_halfway_waits_and_returns(count: int) -> None:
    """ArduPilot truncates its list to the length of the new one, and then replaces item by item."""
    last = holding(Survey(0.0, 0.0, 10.0, 5.0, count=5).items(ARDUPILOT), 90.0)
    waits_at = len(last) - 2
    new = holding(Survey(0.0, 0.0, 20.0, 5.0, count=count).items(ARDUPILOT), 60.0)
    sent, first = after(new, last, waits_at)
    assert sent[0] == new[0]
    assert sent[first : first + len(new) - 1] == new[1:]
    for received in range(len(sent) + 1):
        stored = [*sent[:received], *last[received : len(sent)]]
        assert stored[waits_at] == last[waits_at]
        assert stored[waits_at + 1].command == Command.RETURN_TO_LAUNCH
    ends = first + len(new) - 3  # where it waits next
    assert sent[ends] == new[-2]
    assert waits_at not in range(first, ends + 1)


def test_after_a_pause_the_gimbal_turns_again() -> None:
    items = Survey(60.0, 8.0, radius_m=100.0, height_m=50.0, count=3).items(ARDUPILOT)
    turns = [number for number, item in enumerate(items) if item.command == Command.MOUNT_CONTROL]
    taken = [number for number, item in enumerate(items) if item.command == Command.DIGICAM_CONTROL]
    assert resumes_at(items, 1) == 1  # it takes off
    for turn, shutter in zip(turns, taken, strict=True):
        assert {resumes_at(items, number) for number in range(turn, shutter + 1)} == {turn}
        assert resumes_at(items, shutter + 1) == shutter + 1  # the photograph is taken
