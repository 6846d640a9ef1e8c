"""Views that are rolled: a gimbal keeps level."""

import csv
import json
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame

from fvs_engine.geometry import quaternion_from_matrix
from fvs_engine.geometry.geodetic import camera_at
from fvs_schema.missions import MissionFile, MissionOptions, MissionView
from fvs_schema.poses import FramePose

HOME = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 500.0}
OF_GIMBALS = ("qgc-plan", "qgc-wpl", "dji-kmz", "litchi-csv", "mavsdk", "kml", "briefing")
OTHERS = ("csv", "geojson", "ros-posearray", "ros-posestamped")


def _view(roll: float, pitch: float = -30.0, yaw: float = 70.0) -> MissionView:
    """A view that is higher the more it is rolled."""
    rotation = camera_at(np.zeros(3), yaw, pitch, roll).rotation
    pose = FramePose(
        position=(9.0, 9.0, 30.0 + abs(roll) + roll / 10),
        orientation_wxyz=tuple(quaternion_from_matrix(rotation)),
    )
    return MissionView(id=f"rolled-{roll:g}", pose=pose)


@pytest.fixture
def write(scene: Callable[..., WorldFrame]) -> Callable[..., MissionFile]:
    def write(views: list[MissionView], **options: Any) -> MissionFile:
        wanted = MissionOptions.model_validate({**HOME, "autopilot": "px4", **options})
        return write_mission("m", scene(), views, (), wanted, None)

    return write


@pytest.mark.parametrize("name", OF_GIMBALS)
def test_a_rolled_view_is_refused_by_name(write: Callable[..., MissionFile], name: str) -> None:
    views = [_view(0.0), _view(4.9), _view(-4.9), _view(40.0), _view(-7.5), _view(90.0)]
    with pytest.raises(InvalidRequestError) as refused:
        write(views, format=name)
    assert {error.field: error.message for error in refused.value.errors} == {
        "rolled-40": "it is rolled by 40.0°, and a gimbal keeps level",
        "rolled--7.5": "it is rolled by -7.5°, and a gimbal keeps level",
        "rolled-90": "it is rolled by 90.0°, and a gimbal keeps level",
    }
    assert write(views, format=name, leave_out=True).left_out == ("rolled-40", "rolled--7.5", "rolled-90")


@pytest.mark.parametrize("name", OTHERS)
def test_formats_that_have_roll_keep_it(write: Callable[..., MissionFile], name: str) -> None:
    file = write([_view(40.0)], format=name)
    if name == "csv":
        (row,) = csv.DictReader(file.content.decode().splitlines())
        assert float(row["roll_deg"]) == pytest.approx(40.0, abs=1e-3)


@pytest.mark.parametrize("pitch", [-90.0, -89.999, -89.5, -85.5])
@pytest.mark.parametrize("roll", [0.0, 40.0, -130.0])
def test_straight_down_the_yaw_turns_the_photograph_as_the_view_is(
    write: Callable[..., MissionFile], pitch: float, roll: float
) -> None:
    view = _view(roll, pitch)
    (item,) = json.loads(write([view], format="mavsdk", takeoff=False).content)["mission_plan"][
        "mission_items"
    ]
    flown = camera_at(np.zeros(3), item["yaw_deg"], item["gimbal_pitch_deg"]).rotation
    wanted = camera_at(np.zeros(3), 70.0, pitch, roll).rotation
    cosine = (np.trace(flown.T @ wanted) - 1.0) / 2.0
    assert np.rad2deg(np.arccos(min(1.0, cosine))) <= 1.01 * (90.0 + pitch) + 0.01
