"""Missions over a terrain: heights are above the ground, and nothing is flown into it."""

import csv
import json
import zipfile
from collections.abc import Callable, Sequence
from io import BytesIO
from typing import Any
from xml.etree import ElementTree

import pytest
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame

from fvs_schema.missions import MissionFile, MissionOptions, MissionView
from fvs_schema.poses import VehiclePose
from fvs_schema.scenes import Alignment, AlignmentStatus, AltitudeDatum
from fvs_schema.terrain import NO_HEIGHT_M, Terrain

HOME = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75}
Write = Callable[..., MissionFile]
_STEP_DEG = 1e-4
_COLUMNS = 21


def _terrain(heights: Callable[[int], float], datum: str = "sea-level") -> Terrain:
    """The ground around home; ``heights`` of steps east of home, above 1000 m."""
    row = [1000.0 + heights(column - 10) for column in range(_COLUMNS)]
    return Terrain(
        south_deg=46.02 - 2 * _STEP_DEG,
        west_deg=7.75 - 10 * _STEP_DEG,
        latitude_step_deg=_STEP_DEG,
        longitude_step_deg=_STEP_DEG,
        columns=_COLUMNS,
        heights_m=tuple(row * 5),
        altitude_datum=AltitudeDatum(datum),
    )


def _slope(east: int) -> float:
    return 10.0 * east


def _hill(east: int) -> float:
    return 30.0 if 3 <= east <= 5 else 0.0


def _view(name: str, east: float, altitude_m: float) -> MissionView:
    """A view ``east`` steps from home."""
    pose = VehiclePose(
        latitude_deg=46.02,
        longitude_deg=7.75 + _STEP_DEG * east,
        altitude_m=altitude_m,
        yaw_deg=90.0,
        pitch_deg=-30.0,
    )
    return MissionView(id=name, pose=pose)


@pytest.fixture
def write(scene: Callable[..., WorldFrame]) -> Write:
    def write(
        views: Sequence[MissionView], terrain: Terrain | None, *, datum: str = "sea-level", **options: Any
    ) -> MissionFile:
        wanted = MissionOptions.model_validate({"format": "csv", **HOME, **options})
        return write_mission("m", scene(datum, 500.0), views, (), wanted, None, terrain=terrain)

    return write


def _rows(file: MissionFile) -> list[tuple[str, float]]:
    rows = csv.DictReader(file.content.decode().splitlines())
    return [(row["id"], round(float(row["altitude_m"]), 2)) for row in rows]


def _reasons(refused: Any) -> dict[str, str]:
    return {error.field: error.message for error in refused.value.errors}


def test_views_under_the_ground_and_beside_the_terrain_are_told(write: Write) -> None:
    views = [
        *(_view("good", 2, 1040.0), _view("under", 4, 1037.0), _view("low", 4, 1043.0)),
        *(_view("high", -4, 1100.0), _view("away", 12, 1200.0)),
    ]
    limits = {"lowest_height_m": 5.0, "highest_height_m": 120.0}
    with pytest.raises(InvalidRequestError) as refused:
        write(views, _terrain(_slope), **limits)
    assert _reasons(refused) == {
        "under": "it is under ground: 3.0 m below the terrain",
        "low": "it is 3.0 m above the ground; the lowest allowed is 5 m",
        "high": "it is 140.0 m above the ground; the highest allowed is 120 m",
        "away": "it is at 46.020000, 7.751200, where the terrain has no height",
    }
    file = write(views, _terrain(_slope), **limits, leave_out=True)
    assert _rows(file) == [("good", 40.0)]  # above home, whose altitude is the terrain's
    assert file.left_out == ("under", "low", "high", "away")


def test_the_ground_is_counted_from_homes_altitude(write: Write) -> None:
    """Photographs that are 500 m off, by the same everywhere, are flown all the same."""
    views = [_view("a", 2, 540.0), _view("b", 4, 537.0)]
    file = write(views, _terrain(_slope), home_altitude_m=500.0, leave_out=True)
    assert _rows(file) == [("a", 40.0)]
    assert file.reasons == ("it is under ground: 3.0 m below the terrain",)


def test_a_scene_above_takeoff_and_one_above_the_ellipsoid_have_the_same_ground(write: Write) -> None:
    def flown(height_m: float, datum: str, **options: Any) -> MissionFile:
        view = _view("a", 2, height_m)
        pose = view.pose.model_copy(update={"altitude_datum": AltitudeDatum(datum)})
        return write([view.model_copy(update={"pose": pose})], _terrain(_slope), datum=datum, **options)

    assert _rows(flown(25.0, "takeoff")) == [("a", 25.0)]
    assert _rows(flown(1075.0, "ellipsoid", geoid_height_m=50.0)) == [("a", 25.0)]
    with pytest.raises(InvalidRequestError, match=r"under ground: 5\.0 m below the terrain"):
        flown(15.0, "takeoff")
    with pytest.raises(InvalidRequestError, match=r"under ground: 5\.0 m below the terrain"):
        flown(1065.0, "ellipsoid", geoid_height_m=50.0)
    with pytest.raises(InvalidRequestError, match=r"above sea level, the scene's .* above the ellipsoid"):
        flown(1075.0, "ellipsoid")


def test_ways_lead_over_hills_or_are_refused(write: Write) -> None:
    views = [_view("west", 1, 1010.0), _view("east", 8, 1010.0)]
    with pytest.raises(InvalidRequestError) as refused:
        write(views, _terrain(_hill))
    reason = _reasons(refused)["east"]
    assert reason.startswith("the way to it is, over 46.020000, 7.7503")
    assert reason.endswith("under ground: 20.0 m below the terrain")
    flown = _rows(write(views, _terrain(_hill), transit_height_m=15.0))
    assert flown == [
        *(("", 15.0), ("west", 10.0)),  # over flat ground
        *(("", 45.0), ("", 45.0), ("east", 10.0)),  # 15 m over the hill
        ("", 45.0),  # and back over it
    ]
    with pytest.raises(InvalidRequestError) as refused:
        write(views, _terrain(_hill), transit_height_m=15.0, highest_height_m=40.0)
    assert "45.0 m above the ground; the highest allowed is 40 m" in _reasons(refused)["east"]


def test_the_first_way_is_checked_from_the_takeoff(write: Write) -> None:
    behind = [_view("behind", 8, 1010.0)]
    with pytest.raises(InvalidRequestError, match="The view behind cannot be flown: the way to it is"):
        write(behind, _terrain(_hill))
    write(behind, _terrain(_hill), takeoff=False)


def test_a_hole_on_the_way_is_told_and_one_elsewhere_is_not(write: Write) -> None:
    def holed(east: int) -> float:
        return NO_HEIGHT_M - 1000.0 if east == 5 else 0.0

    with pytest.raises(InvalidRequestError) as refused:
        write([_view("behind", 8, 1010.0)], _terrain(holed))
    assert _reasons(refused)["behind"].endswith("where the terrain has no height")
    assert _rows(write([_view("before", 3, 1010.0)], _terrain(holed))) == [("before", 10.0)]
    with pytest.raises(InvalidRequestError, match=r"no height at home, 46\.020000, 7\.750500"):
        write([_view("a", 3, 1010.0)], _terrain(holed), home_longitude_deg=7.7505)


def test_a_terrain_needs_a_home(scene: Callable[..., WorldFrame]) -> None:
    options = MissionOptions.model_validate({"format": "csv"})
    with pytest.raises(InvalidRequestError, match="With a terrain, home must be known"):
        write_mission("m", scene(), [_view("a", 1, 1010.0)], (), options, None, terrain=_terrain(_slope))


def test_qgroundcontrols_terrain_frame_has_heights_above_the_ground(write: Write) -> None:
    views = [_view("a", 2, 1045.0), _view("b", 4, 1060.0)]
    plan = json.loads(write(views, _terrain(_slope), format="qgc-plan", above_ground=True).content)
    items = [item for item in plan["mission"]["items"] if item["command"] in (16, 22)]
    assert [(item["frame"], item["AltitudeMode"]) for item in items] == [(3, 1), (10, 4), (10, 4)]
    assert [item["params"][6] for item in items] == pytest.approx([45.0, 25.0, 20.0])
    assert plan["mission"]["globalPlanAltitudeMode"] == 0
    text = write(views, _terrain(_slope), format="qgc-wpl", above_ground=True).content.decode()
    lines = [line.split("\t") for line in text.splitlines()[2:]]
    waypoints = [line for line in lines if line[3] == "16"]
    assert [line[2] for line in waypoints] == ["10", "10"]
    assert [float(line[10]) for line in waypoints] == pytest.approx([25.0, 20.0])
    # A vehicle that follows the ground flies over the hill from one to the other.
    over = [_view("west", 1, 1010.0), _view("east", 8, 1010.0)]
    write(over, _terrain(_hill), format="qgc-wpl", above_ground=True)


def test_djis_template_has_heights_above_the_ground_and_flies_those_above_home(write: Write) -> None:
    file = write([_view("a", 2, 1045.0)], _terrain(_slope), format="dji-kmz", above_ground=True)
    name = "{http://www.dji.com/wpmz/1.0.2}"
    with zipfile.ZipFile(BytesIO(file.content)) as archive:
        template, waylines = (
            ElementTree.fromstring(archive.read(f"wpmz/{one}")) for one in ("template.kml", "waylines.wpml")
        )
    assert template.findtext(f".//{name}heightMode") == "aboveGroundLevel"
    assert float(str(template.findtext(f".//{name}height"))) == pytest.approx(25.0)
    assert waylines.findtext(f".//{name}executeHeightMode") == "relativeToStartPoint"
    assert float(str(waylines.findtext(f".//{name}executeHeight"))) == pytest.approx(45.0)


@pytest.mark.parametrize(
    ("options", "terrain", "said"),
    [
        ({"format": "qgc-plan"}, None, "above_ground: a terrain is missing."),
        ({"format": "csv"}, _terrain(_slope), "above_ground: CSV has no altitudes above the ground."),
        ({"format": "mavsdk"}, _terrain(_slope), "above_ground: MAVSDK has no altitudes above the ground."),
        (
            {"format": "qgc-plan", "autopilot": "px4"},
            _terrain(_slope),
            "above_ground: PX4 flies no missions above the ground.",
        ),
    ],
)
def test_files_without_altitudes_above_the_ground_say_so(
    write: Write, options: dict[str, str], terrain: Terrain | None, said: str
) -> None:
    with pytest.raises(InvalidRequestError) as refused:
        write([_view("a", 2, 1045.0)], terrain, above_ground=True, **options)
    assert refused.value.message == said


def test_a_scene_nowhere_on_earth_has_no_terrain() -> None:
    frame = WorldFrame(None, Alignment(status=AlignmentStatus.MODEL))
    options = MissionOptions.model_validate({"format": "nerfstudio"})
    with pytest.raises(InvalidRequestError, match="terrain has no meaning"):
        write_mission("m", frame, [_view("a", 1, 1.0)], (), options, None, terrain=_terrain(_slope))
