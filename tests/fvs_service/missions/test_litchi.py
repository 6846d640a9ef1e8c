"""Litchi's CSV, read by litchi-wp."""

from pathlib import Path
from typing import Any

import pytest
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.writing import write_mission
from litchi_wp.enums import ActionType, GimbalMode
from litchi_wp.waypoint import Waypoint

from fvs_schema.missions import MissionOptions, MissionView
from fvs_schema.poses import VehiclePose

HOME = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 500.0}


def _view(name: str, east: float = 1.0, **pose: float) -> MissionView:
    """A view ``east`` ten-thousandths of a degree from home, 7.7 m each."""
    place = {"latitude_deg": 46.02, "longitude_deg": 7.75 + 1e-4 * east, "altitude_m": 520.0}
    looks = {"yaw_deg": 90.0, "pitch_deg": -30.0}
    return MissionView(id=name, pose=VehiclePose(**{**place, **looks, **pose}))


def _written(scene: Any, *views: MissionView, **options: Any) -> bytes:
    wanted = MissionOptions.model_validate({"format": "litchi-csv", **HOME, **options})
    return write_mission("m", scene(), views, (), wanted, None).content


def test_many_missions_come_back_from_litchi(flights: Any, errors: Any, tmp_path: Path) -> None:
    file = tmp_path / "mission.csv"
    for flight in flights:
        if len(flight.views) == 1:
            continue  # Litchi flies two waypoints or more
        content = flight.write(format="litchi-csv", speed_m_s=3.0, hold_s=2.5).decode()
        header, *lines = content.splitlines(keepends=True)
        assert header.strip() == Waypoint.get_header().strip()
        file.write_text("".join(lines))
        waypoints = [Waypoint.from_line(line.strip()) for line in lines]
        views = [point for point in waypoints if point.actions[0].type is not ActionType.NO_ACTION]
        for view, point in zip(flight.views, views, strict=True):
            rotate, tilt, stay, photograph, *others = point.actions
            assert [action.type for action in (rotate, tilt, stay, photograph)] == [
                *(ActionType.ROTATE_AIRCRAFT, ActionType.TILT_CAMERA, ActionType.STAY_FOR),
                ActionType.TAKE_PHOTO,
            ]
            assert {action.type for action in others} == {ActionType.NO_ACTION}
            assert (rotate.param, tilt.param) == (point.heading, point.gimbal.pitchangle)
            assert stay.param == 2500
            place = (point.lat, point.lon, point.altitude.value - flight.to_takeoff_m)
            errors.add(flight, view, place, point.heading, point.gimbal.pitchangle)
        for point in waypoints:
            assert point.gimbal.mode is GimbalMode.INTERPOLATE
            assert (point.speed, point.altitude.mode.value, point.curvesize) == (3.0, 0, 0.0)
            assert (point.poi.lat, point.photo.time_interval, point.photo.distance_interval) == (
                0.0,
                -1.0,
                -1.0,
            )
    errors.check("Litchi", degrees=0.51)


def test_headings_are_whole_degrees_below_360(scene: Any) -> None:
    lines = _written(scene, _view("a", yaw_deg=359.7), _view("b", 2.0, yaw_deg=180.4)).decode().splitlines()
    assert [Waypoint.from_line(line).heading for line in lines[1:]] == [0.0, 180.0]


@pytest.mark.parametrize(
    ("views", "options", "said"),
    [
        ((_view("a"),), {}, "one waypoint, and Litchi flies two or more"),
        ((_view("a"), _view("b", 1.01)), {}, "a and b are 0.1 m apart"),
        ((_view("a"), _view("b", 300.0)), {}, "a and b are 2315.3 m apart"),
        ((_view("a"), _view("b", 2.0, altitude_m=1101.0)), {}, "601 m above home"),
        (
            (_view("a"), _view("b", 2.0, pitch_deg=40.0)),
            {"gimbal_highest_deg": 45.0},
            "b has a pitch of 40.0",
        ),
        ((_view("a"), _view("b", 2.0)), {"speed_m_s": 16.0}, "speed_m_s is 16; Litchi has 0.1 to 15"),
        ((_view("a"), _view("b", 2.0)), {"hold_s": 33.0}, "hold_s is 33; Litchi has 0 to 32"),
        ((_view("a"), _view("b", 2.0)), {"altitude_datum": "sea-level"}, "Litchi has no altitudes above sea"),
    ],
)
def test_what_litchi_cannot_fly_is_refused(
    scene: Any, views: Any, options: dict[str, Any], said: str
) -> None:
    with pytest.raises(InvalidRequestError, match=said):
        _written(scene, *views, **options)
