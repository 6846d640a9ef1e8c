"""Surveys that leave the geofence or the height band are refused before takeoff."""

import math
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import SURVEY, Flown
from fvs_client import Scene
from fvs_client.fly.dialects import PX4
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending
from fvs_client.fly.ground import Ground
from fvs_client.fly.items import Command
from fvs_client.fly.survey_limits import require_within_limits
from fvs_client.models.missions import MissionSettings

from fvs_schema.terrain import Terrain

_HOME = (47.3769, 8.5417)
_DEGREE_M = 111_195.0


def place(east_m: float, north_m: float) -> tuple[float, float]:
    """Of metres from home."""
    latitude_deg = _HOME[0] + north_m / _DEGREE_M
    return latitude_deg, _HOME[1] + east_m / _DEGREE_M / math.cos(math.radians(_HOME[0]))


def fence(*corners: tuple[float, float]) -> str:
    return ";".join("{:.8f},{:.8f}".format(*place(*corner)) for corner in corners)


def box(west_m: float, south_m: float, east_m: float, north_m: float) -> str:
    return fence((west_m, south_m), (east_m, south_m), (east_m, north_m), (west_m, north_m))


# The survey's photographs are 24 m north, north-east and east of home.
NOTCHED = fence((-9, -9), (30, -9), (30, 30), (14, 30), (10, 18), (6, 30), (-9, 30))


@pytest.mark.parametrize(
    ("mission", "reason"),
    [
        ({"highest_height_m": 10.0}, "it is 15 m above home, and the highest allowed is 10 m"),
        ({"lowest_height_m": 20.0}, "it is 15 m above home, and the lowest allowed is 20 m"),
        ({"geofence": box(-30, -30, 20, 30)}, "photograph 3 of 3 is outside of the geofence"),
        ({"geofence": box(5, 5, 30, 30)}, "home is outside of the geofence"),
        ({"geofence": NOTCHED}, "the way from photograph 1 to photograph 2 leaves the geofence"),
        ({"geofence": "47,8;48"}, "the geofence cannot be read: '48' is not a latitude,longitude"),
    ],
)
def test_a_survey_outside_of_a_limit_is_refused(mission: MissionSettings, reason: str) -> None:
    with pytest.raises(VehicleError, match=f"The survey cannot be flown: {reason}."):
        require_within_limits(SURVEY, _HOME, mission)


def test_a_survey_inside_is_flown() -> None:
    mission = MissionSettings(geofence=box(-5, -5, 30, 30), highest_height_m=15.0, lowest_height_m=15.0)
    require_within_limits(SURVEY, _HOME, mission)
    require_within_limits(SURVEY, _HOME, MissionSettings())


def test_the_way_home_stays_inside() -> None:
    behind = fence((-9, -9), (3, -9), (3, 14), (30, -9.5), (30, 30), (-9, 30))  # a wedge south of the east
    with pytest.raises(VehicleError, match="the way from photograph 3 to home leaves"):
        require_within_limits(SURVEY, _HOME, {"geofence": behind})


def test_a_survey_takes_off_where_the_vehicle_is() -> None:
    takeoff = next(item for item in SURVEY.items(PX4, (47.0, 8.0)) if item.command == Command.TAKEOFF)
    assert (takeoff.x, takeoff.y, takeoff.z) == (47.0, 8.0, SURVEY.height_m)


def ground(height: Callable[[float], float]) -> Ground:
    """The ground of ``height`` by metres north of home, in steps of 2 m."""
    step_deg, rows, columns = 2.0 / _DEGREE_M, 41, 41
    heights = [height((row - 20) * 2.0) for row in range(rows) for _ in range(columns)]
    terrain = Terrain(
        south_deg=_HOME[0] - 20 * step_deg,
        west_deg=_HOME[1] - 20 * step_deg * 1.5,
        latitude_step_deg=step_deg,
        longitude_step_deg=step_deg * 1.5,
        columns=columns,
        heights_m=tuple(440.0 + value for value in heights),
    )
    return Ground(terrain, _HOME)


def test_a_survey_over_a_slope_keeps_its_height_above_the_ground() -> None:
    slope = ground(lambda north_m: north_m / 2.0)
    items = SURVEY.items(PX4, _HOME, slope)
    heights = [item.z for item in items if item.command == Command.WAYPOINT][1:]
    assert heights == pytest.approx([27.0, 23.49, 15.0], abs=0.02)  # 24 m, 17 m and 0 m north of home
    assert next(item.z for item in items if item.command == Command.TAKEOFF) == pytest.approx(27.0, abs=0.02)
    pitches = [item.parameters[0] for item in items if item.command == Command.MOUNT_CONTROL]
    downwards = [-math.degrees(math.atan2(height, 24.0)) for height in heights]
    assert pitches == pytest.approx(downwards)
    require_within_limits(SURVEY, _HOME, {"highest_height_m": 15.0, "lowest_height_m": 14.0}, slope)


def test_a_survey_into_a_hill_or_a_hole_is_refused() -> None:
    hill = ground(lambda north_m: 30.0 if 8 <= north_m <= 12 else 0.0)
    with pytest.raises(VehicleError, match=r"the way from home to photograph 1 is 15\.0 m below the ground"):
        require_within_limits(SURVEY, _HOME, {}, hill)
    low = ground(lambda north_m: 6.0 if 8 <= north_m <= 12 else 0.0)
    require_within_limits(SURVEY, _HOME, {}, low)
    with pytest.raises(VehicleError, match=r"9\.0 m above the ground at .*, and the lowest allowed is 10 m"):
        require_within_limits(SURVEY, _HOME, {"lowest_height_m": 10.0}, low)
    holed = ground(lambda north_m: -20_000.0 if north_m > 10 else 0.0)
    with pytest.raises(VehicleError, match=r"The height model has no height at 47\.37"):
        require_within_limits(SURVEY, _HOME, {}, holed)


@pytest.mark.system
@pytest.mark.process
def test_the_vehicle_stays_on_the_ground(simulated: Any, scene: Scene, url: str, tmp_path: Path) -> None:
    with simulated() as simulator, ExitStack() as stack:
        limits = {"geofence": box(-30, -30, 20, 30)}
        flown = Flown(stack, simulator, scene, url, tmp_path / "flight.jsonl", mission=limits)
        result = flown.result()
        assert simulator.autopilot.vehicle.flown_m == 0.0
    assert result.ending is Ending.VEHICLE
    assert "photograph 3 of 3 is outside of the geofence" in result.reason
