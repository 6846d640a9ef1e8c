"""Which trigger of which leg a photograph belongs to."""

import math
import time
from types import SimpleNamespace
from typing import Any

import pytest
from fvs_client import Candidate, VehiclePose
from fvs_client.fly.captures import FOLDER, Capture, Captures, Source
from fvs_client.fly.dialects import ARDUPILOT, PX4, Dialect
from fvs_client.fly.items import PHOTOGRAPHS, Command, Frame, MissionItem, holding
from fvs_client.fly.leg import Leg
from fvs_client.fly.log import FlightLog
from fvs_client.fly.matching import Shot, shot_of
from fvs_client.fly.shots import Shots
from fvs_client.fly.survey import Survey
from fvs_client.fly.telemetry import VehicleState

SURVEY = Survey(47.0, 8.0, radius_m=30.0, height_m=20.0, count=4)
IMAGE, FEEDBACK = Source("image", 100), Source("feedback", 1)
EVERY_S = 10.0


def leg(dialect: Dialect = ARDUPILOT, names: str = "abcd") -> Leg:
    items = holding(SURVEY.items(dialect), 60.0)
    poses = VehiclePose(latitude_deg=47.0, longitude_deg=8.0, altitude_m=20.0, yaw_deg=0.0, pitch_deg=0.0)
    return Leg(items, tuple(Candidate(id=name, pose=poses) for name in names))


def flown(made: Leg, until: int = 4) -> list[Shot]:
    """The shots of a leg that has reached so many of its triggers, ten seconds from one to the next."""
    for number, shot in enumerate(made.shots[:until]):
        made.reach(shot.item, EVERY_S * number)
    return made.shots


def capture(at: Shot | None = None, number: int = 0, source: Source = IMAGE, **more: Any) -> Capture:
    place = None if at is None else (at.place.x + 1e-6, at.place.y - 1e-6)
    return Capture(number, **{"succeeded": True, "file": "", "place": place, "source": source, **more})


def take(captures: list[Capture], shots: list[Shot]) -> list[str | None]:
    """Assign reports, as a flight does; the names of the views they belong to."""
    names = []
    for one in captures:
        shot = shot_of(one, shots)
        if shot is not None:
            shot.reports[one.source] = one
        names.append(shot.view.id if shot and shot.view else None)
    return names


@pytest.mark.parametrize("dialect", [ARDUPILOT, PX4])
def test_each_photograph_is_of_the_view_where_it_was_taken(dialect: Dialect) -> None:
    made = leg(dialect)
    shots = flown(made)
    assert made.count == 4
    assert made.items[made.waits_at].parameters[0] == 60.0
    reports = [capture(shots[0], 7), capture(shots[2], 9), capture(shots[1], 8, succeeded=False)]
    assert take(reports, shots) == ["a", "c", "b"]
    files = [capture(shots[0], 1, FOLDER), capture(shots[2], 2, FOLDER)]
    assert take(files, shots) == ["a", "c"]
    assert [view.id for view in made.succeeded] == ["a", "c"]
    assert [view.id for view in made.left] == ["b", "d"]
    assert [shot.failed for shot in shots] == [False, True, False, False]
    assert not made.settled


def test_positions_to_pass_are_no_views() -> None:
    items = holding(SURVEY.items(ARDUPILOT), 60.0)
    passed = MissionItem(Command.WAYPOINT, Frame.RELATIVE, x=47.0, y=8.0, z=60.0)
    before = next(number for number, item in enumerate(items) if item.command in PHOTOGRAPHS) + 1
    items[before:before] = [passed, passed]  # on the way from the first view to the second
    shots = flown(Leg(items, leg().views))
    assert len(shots) == 4
    assert take([capture(shots[1], height_m=20.0)], shots) == ["b"]


@pytest.mark.parametrize("source", [IMAGE, FEEDBACK, FOLDER])
def test_without_positions_photographs_are_in_order(source: Source) -> None:
    shots = flown(leg())
    assert take([capture(number=number, source=source) for number in range(1, 6)], shots) == [*"abcd", None]


def test_a_photograph_is_never_of_a_trigger_that_the_mission_has_not_reached() -> None:
    made = leg()
    assert take([capture(number=0)], flown(made, 0)) == [None]  # the test photograph, late
    shots = flown(made, 2)
    assert take([capture(shots[3], 1), capture(number=2), capture(number=3)], shots) == ["a", "b", None]


def test_numbers_win_over_positions() -> None:
    shots = flown(leg())
    assert take([capture(number=5), capture(number=8)], shots) == ["a", "d"]  # two were lost
    assert take([capture(shots[0], 7), capture(shots[0], 6)], shots) == ["c", "b"]  # and are repeated


def test_numbers_of_a_camera_that_was_switched_on_again_are_ignored() -> None:
    shots = flown(leg())
    reports = [capture(shots[number], told) for number, told in enumerate((41, 42, 0, 1))]
    assert take(reports, shots) == [*"abcd"]


def test_a_trigger_without_a_photograph_is_seen_by_position_or_else_by_time() -> None:
    shots = flown(leg())
    assert take([capture(shots[n], told) for n, told in ((0, 1), (2, 2), (3, 3))], shots) == ["a", "c", "d"]
    other = flown(leg())
    clock_s = 1.6e9  # the camera's own
    timed = [capture(number=told, time_s=clock_s + EVERY_S * n) for n, told in ((0, 1), (2, 2), (3, 3))]
    assert take(timed, other) == ["a", "c", "d"]
    assert [shot.reported for shot in other] == [True, False, True, True]


def test_a_clock_that_jumps_moves_no_photograph_that_its_position_tells() -> None:
    shots = flown(leg())
    timed = [capture(shots[n], n, time_s=n * EVERY_S + (1e6 if n == 2 else 0)) for n in range(4)]
    assert take(timed, shots) == [*"abcd"]


def test_what_several_sources_report_is_one_photograph() -> None:
    made = leg()
    shots = flown(made)
    reports = [capture(shots[n], n + 1, FEEDBACK) for n in range(4)]
    reports += [capture(shots[n], n, IMAGE, file=f"{n}.jpg") for n in (1, 0, 3)]
    assert take(reports, shots) == [*"abcd", *"bad"]
    assert not any(shot.arrived or shot.failed for shot in shots)  # a trigger is no file
    files = [capture(number=n, source=FOLDER, file=f"{n}.jpg") for n in (3, 1, 0)]
    assert take(files, shots) == ["d", "b", "a"]
    assert [view.id for view in made.left] == ["c"]


def test_a_file_that_the_service_refuses_is_no_photograph() -> None:
    made = leg()
    shots = flown(made)
    for succeeded in (True, False):
        take([capture(number=1, source=FOLDER, file="1.jpg", succeeded=succeeded)], shots)
        assert (shots[0].arrived, shots[0].failed) == (succeeded, not succeeded)


def test_late_photographs_belong_to_the_leg_before() -> None:
    first, second = leg(), leg(names="efgh")
    shots = [*flown(first), *second.shots]
    take([capture(shots[n], n) for n in (0, 1, 3)], shots)
    for shot in first.shots:
        shot.over = True
    assert shots[2].failed
    assert take([capture(number=9, source=FOLDER)], shots) == ["a"]
    for shot in second.shots:
        second.reach(shot.item, 100.0)
    assert take([capture(shots[2], 2)], shots) == ["c"]
    assert take([capture(number=12, source=FOLDER)], shots) == ["e"]  # rather than that of a leg that is over


def test_what_is_said_of_a_photograph_is_where_it_was_taken() -> None:
    shot = flown(leg())[0]
    take([capture(number=1, source=FOLDER), capture(number=1), capture(shot, 1, FEEDBACK)], [shot])
    assert shot.said is shot.reports[FEEDBACK]


def report(number: int, time_ms: int = 0, component: int = 100) -> SimpleNamespace:
    return SimpleNamespace(
        image_index=number,
        time_boot_ms=time_ms or number,
        file_url=f"/x/{number}.jpg\0".encode(),
        lat=0,
        lon=0,
        alt=0,
        relative_alt=0,
        capture_result=1,
        camera_id=0,
        get_srcComponent=lambda: component,
    )


def feedback(number: int, time_us: int, *, flags: int = 0) -> SimpleNamespace:
    """As ArduCopter sent it."""
    return SimpleNamespace(
        time_usec=time_us,
        cam_idx=0,
        img_idx=number,
        lat=473767732,
        lng=85420481,
        alt_msl=453.02,
        alt_rel=12.94,
        flags=flags,
        get_srcComponent=lambda: 1,
    )


def test_reports_that_were_lost_are_asked_for_and_none_counts_twice() -> None:
    asked: list[int] = []
    captures = Captures(asked.append)
    captures.are(100, 7, 5)  # from flights before
    captures.add(report(7))
    captures.add(report(10))
    assert asked == [8, 9]
    for number in (8, 9, 9, 10):
        captures.add(report(number))
    assert [found.number for found in captures.take()] == [7, 10, 8, 9]
    captures.are(100, 13, 20)
    assert asked == [8, 9, 11, 12]
    captures.are(1, 0, 30)  # the autopilot answers, too, and counts for itself
    captures.add(report(13))
    assert asked == [8, 9, 11, 12, 11, 12]
    captures.add(report(0, time_ms=99))  # the camera was switched on again
    assert [found.file for found in captures.take()] == ["13.jpg", "0.jpg"]


def test_photographs_of_earlier_flights_are_not_counted() -> None:
    asked: list[int] = []
    captures = Captures(asked.append)
    captures.are(100, 0, 50_000)  # an old camera, which does not count
    captures.add(report(3, time_ms=60_000))
    assert asked == [0, 1, 2]
    captures.add(report(0, time_ms=1_000))
    captures.add(report(2, time_ms=55_000))
    assert [found.number for found in captures.take()] == [3, 2]


def test_feedback_is_a_report_of_its_own() -> None:
    captures = Captures(lambda _number: pytest.fail("it cannot be requested"))
    for number, time_us in ((1, 10), (1, 10), (4, 40)):  # once twice; two lost
        captures.add_feedback(feedback(number, time_us))
    captures.add_feedback(feedback(5, 50, flags=1))  # a video
    first, last = captures.take()
    assert (first.number, last.number, first.succeeded, first.file) == (1, 4, True, "")
    assert (first.place, first.height_m, first.time_s) == ((47.3767732, 8.5420481), 12.94, 1e-5)
    captures.add(report(0))
    assert captures.take()[0].source != first.source
    assert math.isclose(first.altitude_m, 453.02)


@pytest.mark.parametrize(("looks", "kept"), [(1, True), (60, False)])
def test_a_report_waits_for_the_mission_and_not_for_a_clock(
    monkeypatch: pytest.MonkeyPatch, looks: int, kept: bool
) -> None:
    """Time passes, too, while the program does not run."""
    made = leg()
    reports = [[capture(made.shots[0], 1)]]
    vehicle: Any = SimpleNamespace(captures=lambda: reports.pop() if reports else [])
    photographs: Any = SimpleNamespace(arrived=list)
    shots = Shots(vehicle, photographs, 4, FlightLog(None, lambda _line: None))
    shots.add(made.shots)
    shots.collect(VehicleState())
    later_s = time.monotonic() + 60.0
    monkeypatch.setattr(time, "monotonic", lambda: later_s)
    for _ in range(looks):
        shots.collect(VehicleState())
    made.reach(made.shots[0].item, later_s)
    shots.collect(VehicleState())
    assert made.shots[0].reported is kept
