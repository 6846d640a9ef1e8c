"""What contradicts the altitude of home: the photographs' heights above takeoff, and the model's ground."""

import csv
from collections.abc import Callable
from typing import Any

import pytest
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame
from pydantic import ValidationError

from fvs_schema.missions import MissionFile, MissionOptions, MissionView
from fvs_schema.poses import VehiclePose
from fvs_schema.scenes import Alignment, AlignmentSource, AlignmentStatus, Origin
from fvs_schema.terrain import Terrain

HOME = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75}
VIEW = MissionView(
    id="a",
    pose=VehiclePose(latitude_deg=46.02, longitude_deg=7.75, altitude_m=198.5, yaw_deg=0.0, pitch_deg=-90.0),
)
Write = Callable[..., MissionFile]


def _ground(*rows: float) -> Terrain:
    """Rows of the ground from south to north, the middle one at home, eleven metres apart."""
    return Terrain(
        south_deg=46.02 - 1e-4 * (len(rows) // 2),
        west_deg=7.745,
        latitude_step_deg=1e-4,
        longitude_step_deg=1e-3,
        columns=11,
        heights_m=tuple(height_m for height_m in rows for _ in range(11)),
    )


def _write(takeoff_m: float | None = None, ground: Terrain | None = None, **options: Any) -> MissionFile:
    origin = Origin(latitude_deg=46.02, longitude_deg=7.75, altitude_m=198.0)
    source, terrain = options.pop("source", AlignmentSource.POSITIONS), options.pop("terrain", None)
    alignment = Alignment(status=AlignmentStatus.ALIGNED, source=source, takeoff_altitude_m=takeoff_m)
    wanted = MissionOptions.model_validate({"format": "csv", **HOME, **options})
    frame = WorldFrame(origin, alignment)
    return write_mission("m", frame, [VIEW], (), wanted, None, terrain=terrain, model_ground=ground)


def _height_m(file: MissionFile) -> float:
    (row,) = csv.DictReader(file.content.decode().splitlines())
    assert row["altitude_datum"] == "takeoff"
    return round(float(row["altitude_m"]), 3)


def test_an_altitude_of_home_that_contradicts_the_photographs_is_refused() -> None:
    with pytest.raises(InvalidRequestError) as refused:
        _write(158.5, home_altitude_m=186.0)
    assert refused.value.message == (
        "Home at 186.0 m contradicts the photographs: by their heights above takeoff, their flight took off "
        "at 158.5 m. If home is there, the mission would fly 27.5 m too low."
    )
    assert "home_above_takeoff_m: 0" in refused.value.hint
    with pytest.raises(InvalidRequestError, match="too high"):
        _write(158.5, home_altitude_m=153.4)
    assert _height_m(_write(158.5, home_altitude_m=162.0)) == 36.5
    assert _height_m(_write(home_altitude_m=186.0)) == 12.5  # nothing is known


def test_the_altitude_of_a_terrain_at_home_is_compared_too() -> None:
    with pytest.raises(InvalidRequestError, match=r"27\.5 m too low"):
        _write(158.5, terrain=_ground(186.0, 186.0, 186.0))
    assert _height_m(_write(158.5, terrain=_ground(186.0, 186.0, 186.0), home_above_takeoff_m=0)) == 40.0


def test_home_may_be_given_above_the_takeoff_of_the_photographs() -> None:
    assert _height_m(_write(158.5, home_above_takeoff_m=0)) == 40.0
    assert _height_m(_write(158.5, home_above_takeoff_m=30)) == 10.0
    with pytest.raises(InvalidRequestError, match="do not say how high above takeoff"):
        _write(home_above_takeoff_m=0)
    with pytest.raises(ValidationError, match="give home_altitude_m or home_above_takeoff_m"):
        _write(158.5, home_altitude_m=158.5, home_above_takeoff_m=0)


@pytest.mark.parametrize(
    ("to_fly", "above"), [("qgc-plan", "sea-level"), ("qgc-wpl", "sea-level"), ("dji-kmz", "ellipsoid")]
)
def test_what_is_flown_is_above_home_unless_control_points_relate_altitudes(to_fly: str, above: str) -> None:
    wanted = {"format": to_fly, "geoid_height_m": 0.0}
    with pytest.raises(InvalidRequestError) as refused:
        _write(158.5, **wanted)
    assert "took off at 158.5 m" in refused.value.hint
    absolute = {**wanted, "altitude_datum": above, "home_altitude_m": 159.0}
    with pytest.raises(InvalidRequestError, match="may be off by tens of metres"):
        _write(158.5, **absolute)
    assert _write(158.5, source=AlignmentSource.CONTROL_POINTS, **absolute).content
    assert _write(**absolute).content  # photographs of other cameras


def test_home_in_the_air_above_the_model_s_ground_is_refused() -> None:
    flat = _ground(158.0, 158.0, 158.0)
    with pytest.raises(
        InvalidRequestError, match=r"28\.0 m above the ground of the model, which is at 158\.0 m"
    ):
        _write(ground=flat, home_altitude_m=186.0)
    assert _height_m(_write(ground=flat, home_altitude_m=167.0)) == 31.5
    assert _height_m(_write(ground=flat, home_altitude_m=140.0)) == 58.5  # trees hide the ground
    edge = _ground(158.0, 158.0, 158.0, 158.0, 186.0)
    assert _height_m(_write(ground=edge, home_altitude_m=186.0)) == 12.5
    away = {"home_latitude_deg": 46.03, "home_altitude_m": 186.0}
    assert _height_m(_write(ground=flat, **away)) == 12.5  # the model does not say
    assert _height_m(_write(186.0, flat, home_altitude_m=186.0)) == 12.5  # the photographs do


def test_home_on_the_model_s_ground_may_be_elsewhere_than_takeoff() -> None:
    hill = _ground(158.0, 180.0, 186.0, 186.0, 186.0)
    assert _height_m(_write(158.5, hill, home_altitude_m=186.0)) == 12.5
    with pytest.raises(InvalidRequestError, match="contradicts the photographs"):
        _write(158.5, hill, home_altitude_m=192.0)
