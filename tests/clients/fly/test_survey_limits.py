"""Surveys that leave the geofence or the height band are refused before takeoff."""

import math
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from flights import SURVEY, Flown
from fvs_client import Scene
from fvs_client.fly.dialects import PX4
from fvs_client.fly.errors import VehicleError
from fvs_client.fly.flight import Ending
from fvs_client.fly.items import Command
from fvs_client.fly.survey_limits import require_within_limits
from fvs_client.models.missions import MissionSettings

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
