"""Which view a photograph is of."""

from types import SimpleNamespace

import pytest
from fvs_client import Candidate, VehiclePose
from fvs_client.fly.captures import Capture, Captures
from fvs_client.fly.dialects import ARDUPILOT, PX4, Dialect
from fvs_client.fly.items import PHOTOGRAPHS, Command, Frame, MissionItem, holding
from fvs_client.fly.leg import Leg
from fvs_client.fly.survey import Survey

SURVEY = Survey(47.0, 8.0, radius_m=30.0, height_m=20.0, count=4)


def leg(dialect: Dialect = ARDUPILOT) -> Leg:
    items = holding(SURVEY.items(dialect), 60.0)
    poses = VehiclePose(latitude_deg=47.0, longitude_deg=8.0, altitude_m=20.0, yaw_deg=0.0, pitch_deg=0.0)
    return Leg(items, tuple(Candidate(id=name, pose=poses) for name in "abcd"))


def capture(made: Leg, number: int, *, succeeded: bool = True, place: bool = True) -> Capture:
    item = made._places()[number]
    where = (item.x + 1e-6, item.y - 1e-6) if place else None
    return Capture(number, succeeded, "x.jpg", where, altitude_m=460.0, height_m=item.z - 0.4)


@pytest.mark.parametrize("dialect", [ARDUPILOT, PX4])
def test_each_photograph_is_of_the_view_where_it_was_taken(dialect: Dialect) -> None:
    made = leg(dialect)
    assert made.count == 4
    assert made.items[made.waits_at].parameters[0] == 60.0
    named = [
        made.take(capture(made, 0)),
        made.take(capture(made, 2)),
        made.take(capture(made, 1, succeeded=False)),
    ]
    assert [view.id for view in named if view] == ["a", "c", "b"]
    assert ([view.id for view in made.succeeded], [view.id for view in made.failed]) == (["a", "c"], ["b"])
    assert [view.id for view in made.left] == ["d"]


def test_positions_to_pass_are_no_views() -> None:
    made = leg()
    passed = MissionItem(Command.WAYPOINT, Frame.RELATIVE, x=47.0, y=8.0, z=60.0)
    before = next(number for number, item in enumerate(made.items) if item.command in PHOTOGRAPHS) + 1
    made.items[before:before] = [passed, passed]  # on the way from the first view to the second
    assert made.count == 4
    view = made.take(Capture(0, True, "x.jpg", (made._places()[1].x, made._places()[1].y), height_m=20.0))
    assert view is not None
    assert view.id == "b"


def test_without_positions_photographs_are_in_order() -> None:
    made = leg()
    named = [made.take(capture(made, number, place=False)) for number in (3, 2, 1, 0, 0)]
    assert [view and view.id for view in named] == ["a", "b", "c", "d", None]


def report(number: int, time_ms: int = 0) -> SimpleNamespace:
    return SimpleNamespace(
        image_index=number,
        time_boot_ms=time_ms or number,
        file_url=f"/x/{number}.jpg\0".encode(),
        lat=0,
        lon=0,
        alt=0,
        relative_alt=0,
        capture_result=1,
    )


def test_reports_that_were_lost_are_asked_for_and_none_counts_twice() -> None:
    asked: list[int] = []
    captures = Captures(asked.append)
    captures.are(7, 5)  # from flights before
    captures.add(report(7))
    captures.add(report(10))
    assert asked == [8, 9]
    for number in (8, 9, 9, 10):
        captures.add(report(number))
    assert [found.number for found in captures.take()] == [7, 10, 8, 9]
    captures.are(13, 20)
    assert asked == [8, 9, 11, 12]
    captures.add(report(0, time_ms=99))  # the camera was switched on again
    assert [found.file for found in captures.take()] == ["0.jpg"]


def test_photographs_of_earlier_flights_are_not_counted() -> None:
    asked: list[int] = []
    captures = Captures(asked.append)
    captures.are(0, 50_000)  # an old camera, which does not count
    captures.add(report(3, time_ms=60_000))
    assert asked == [0, 1, 2]
    captures.add(report(0, time_ms=1_000))
    captures.add(report(2, time_ms=55_000))
    assert [found.number for found in captures.take()] == [3, 2]
