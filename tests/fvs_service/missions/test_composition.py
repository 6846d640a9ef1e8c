"""What is flown between views, and what cannot be flown."""

import csv
import json
from collections.abc import Callable, Sequence
from itertools import pairwise
from typing import Any

import pytest
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame

from fvs_schema.missions import MissionFile, MissionOptions, MissionView
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.scenes import Alignment, AlignmentStatus, AltitudeDatum

HOME = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 500.0}
AROUND = "46.01,7.74;46.03,7.74;46.03,7.76;46.01,7.76"
Write = Callable[..., MissionFile]


def _view(name: str, east: float, height: float, pitch: float = -30.0, via: Any = ()) -> MissionView:
    """A view ``east`` ten-thousandths of a degree from home."""
    return MissionView(id=name, pose=_pose(east, height, pitch), via=via)


def _pose(east: float, height: float, pitch: float = -30.0) -> VehiclePose:
    return VehiclePose(
        latitude_deg=46.02,
        longitude_deg=7.75 + 1e-4 * east,
        altitude_m=500.0 + height,
        yaw_deg=90.0,
        pitch_deg=pitch,
    )


@pytest.fixture
def write(scene: Callable[..., WorldFrame]) -> Write:
    def write(
        views: Sequence[MissionView], *, ground_m: float | None = None, via_home: Any = (), **options: Any
    ) -> MissionFile:
        wanted = MissionOptions.model_validate({"format": "csv", **options})
        return write_mission("m", scene(), views, via_home, wanted, ground_m)

    return write


def _rows(file: MissionFile) -> list[tuple[str, float]]:
    """The ids and altitudes of a table."""
    return [
        (row["id"], round(float(row["altitude_m"]), 3))
        for row in csv.DictReader(file.content.decode().splitlines())
    ]


def test_views_are_flown_straight_by_default(write: Write) -> None:
    views = [_view("a", 1, 20), _view("b", 2, 30)]
    assert _rows(write(views)) == [("a", 520.0), ("b", 530.0)]
    assert _rows(write(views, **HOME)) == [("a", 20.0), ("b", 30.0)]
    assert _rows(write(views, **HOME, altitude_datum="sea-level")) == [("a", 520.0), ("b", 530.0)]


def test_a_transit_goes_up_over_and_down(write: Write) -> None:
    views = [_view("a", 1, 20), _view("b", 2, 30), _view("c", 3, 60)]
    flown = _rows(write(views, **HOME, transit_height_m=40.0))
    assert flown == [
        *(("", 40.0), ("a", 20.0), ("", 40.0), ("", 40.0), ("b", 30.0)),
        *(("", 60.0), ("c", 60.0)),  # as high as the higher end; and home from there
    ]
    held = _rows(write(views[:1], **HOME, transit_height_m=40.0, finish="hold"))
    assert held == [("", 40.0), ("a", 20.0)]


def test_the_ways_of_a_plan_replace_the_transit(write: Write) -> None:
    views = [_view("a", 1, 20), _view("b", 2, 30, via=(_pose(1.5, 80),))]
    flown = _rows(write(views, **HOME, transit_height_m=40.0, via_home=(_pose(1, 70),)))
    assert flown == [("", 40.0), ("a", 20.0), ("", 80.0), ("b", 30.0), ("", 70.0)]


def _reasons(refused: Any) -> dict[str, str]:
    return {error.field: error.message for error in refused.value.errors}


def test_every_view_that_cannot_be_flown_is_named_with_the_reason(write: Write) -> None:
    views = [
        *(_view("good", 1, 20), _view("high", 1, 130), _view("low", 1, 4), _view("far", 101, 20)),
        *(_view("up", 1, 20, 45.0), _view("last", 2, 20)),
    ]
    limits = {"lowest_height_m": 5.0, "highest_height_m": 120.0, "geofence": AROUND, **HOME}
    with pytest.raises(InvalidRequestError) as refused:
        write(views, **limits)
    assert _reasons(refused) == {
        "high": "it is 130.0 m above home; the highest allowed is 120 m",
        "low": "it is 4.0 m above home; the lowest allowed is 5 m",
        "far": "it is outside of the geofence",
        "up": "it needs a gimbal pitch of 45.0°; -90° to 30° are allowed",
    }
    assert refused.value.message == (
        "4 views cannot be flown. The first is high: it is 130.0 m above home; the highest allowed is 120 m."
    )
    assert "leave_out=true" in refused.value.hint
    file = write(views, **limits, leave_out=True)
    assert [name for name, _ in _rows(file)] == ["good", "last"]
    assert file.left_out == ("high", "low", "far", "up")
    assert file.reasons == tuple(_reasons(refused).values())


def test_a_gimbal_has_its_own_limits(write: Write) -> None:
    write([_view("a", 1, 20, -90.0)], gimbal_lowest_deg=-90.0)
    with pytest.raises(InvalidRequestError, match=r"-50\.0°; -45° to 0° are allowed"):
        write([_view("a", 1, 20, -50.0)], gimbal_lowest_deg=-45.0, gimbal_highest_deg=0.0)


def test_views_under_ground_are_refused(write: Write) -> None:
    with pytest.raises(
        InvalidRequestError, match=r"a cannot be flown: it is 3\.0 m below home; the lowest allowed is 0 m\."
    ):
        write([_view("a", 1, -3)], **HOME)
    write([_view("a", 1, -3)], **HOME, lowest_height_m=-10.0)  # on a cliff
    # Without home the lowest point of the model is the ground.
    with pytest.raises(InvalidRequestError, match=r"under ground: 7\.0 m below the lowest point"):
        write([_view("a", 1, -3)], ground_m=4.0)
    write([_view("a", 1, -3)], ground_m=-4.0)
    write([_view("a", 1, -3)])


def test_heights_need_home(write: Write) -> None:
    for name in ("transit_height_m", "lowest_height_m", "highest_height_m"):
        with pytest.raises(InvalidRequestError) as refused:
            write([_view("a", 1, 20)], **{name: 30.0})
        assert _reasons(refused) == {name: "home_altitude_m is missing"}


def test_ways_stay_inside_the_fence(write: Write) -> None:
    notch = (
        "46.01,7.74;46.03,7.74;46.03,7.7502;46.0199,7.7502;46.0199,7.7504;46.03,7.7504;46.03,7.76;46.01,7.76"
    )
    views = [_view("near", 1, 20), _view("beyond", 6, 20)]
    with pytest.raises(InvalidRequestError, match="beyond cannot be flown: the way to it leaves"):
        write(views, **HOME, geofence=notch)
    around = VehiclePose(latitude_deg=46.0195, longitude_deg=7.7503, altitude_m=530, yaw_deg=0, pitch_deg=0)
    detour = [views[0], _view("beyond", 6, 20, via=(around,))]
    write(detour, **HOME, geofence=notch, finish="hold")
    with pytest.raises(InvalidRequestError, match="beyond cannot be flown: the way home from it leaves"):
        write(detour, **HOME, geofence=notch)
    write(detour, **HOME, geofence=notch, via_home=(around,))
    assert write(detour, **HOME, geofence=notch, leave_out=True).left_out == ("beyond",)
    with pytest.raises(InvalidRequestError, match="Home is outside"):
        write(views, **{**HOME, "home_latitude_deg": 46.5}, geofence=notch)


def test_ways_stay_under_the_highest_height(write: Write) -> None:
    via = [_view("a", 1, 20, via=(_pose(1.5, 80),))]
    with pytest.raises(InvalidRequestError, match=r"the way to it is 80\.0 m above home"):
        write(via, **HOME, highest_height_m=50.0)
    with pytest.raises(InvalidRequestError, match="the transit to it is 60 m above home"):
        write([_view("a", 1, 20)], **HOME, highest_height_m=50.0, transit_height_m=60.0)


def test_ways_stay_above_the_ground_and_the_lowest_height(write: Write) -> None:
    for height, reason in (
        (-5, r"5\.0 m below home; the lowest"),
        (2, r"2\.0 m above home; the lowest"),
    ):
        passed = (_pose(1.5, height),)
        with pytest.raises(InvalidRequestError, match=f"the way to it is {reason}"):
            write([_view("a", 1, 20, via=passed)], **HOME, lowest_height_m=4.0)
        with pytest.raises(InvalidRequestError, match=f"the way home from it is {reason}"):
            write([_view("a", 1, 20)], **HOME, lowest_height_m=4.0, via_home=passed)
        write([_view("a", 1, 20)], **HOME, lowest_height_m=4.0, via_home=passed, finish="hold")


def test_positions_to_pass_go_with_the_view_that_is_left_out(write: Write) -> None:
    views = [
        _view("a", 1, 20),
        _view("high", 2, 200, via=(_pose(1.5, 31),)),
        _view("b", 3, 20, via=(_pose(2.5, 32),)),
        _view("c", 4, 20, via=(_pose(3.5, 33),)),
    ]
    options = {**HOME, "highest_height_m": 100.0, "via_home": (_pose(1, 34),)}
    with pytest.raises(InvalidRequestError) as refused:
        write(views, **options)
    assert list(_reasons(refused)) == ["high"]
    left = write(views, **options, leave_out=True)
    assert _rows(left) == [("a", 20.0), ("b", 20.0), ("", 33.0), ("c", 20.0), ("", 34.0)]
    left = write([*views, _view("low", 1, -9)], **options, leave_out=True)
    assert _rows(left) == [("a", 20.0), ("b", 20.0), ("", 33.0), ("c", 20.0)]


def test_a_mission_without_views_is_refused(write: Write) -> None:
    with pytest.raises(InvalidRequestError, match="There is no view to fly to"):
        write([])
    with pytest.raises(InvalidRequestError, match=r"No view is left\. The view a cannot be flown") as refused:
        write([_view("a", 1, 999)], **HOME, highest_height_m=50.0, leave_out=True)
    assert "leave" not in refused.value.hint


@pytest.mark.parametrize(
    ("datum", "options", "remedy"),
    [
        ("ellipsoid", {}, "home_altitude_m"),
        ("ellipsoid", {"altitude_datum": "sea-level"}, "geoid_height_m"),
        ("sea-level", {"altitude_datum": "takeoff"}, "home_altitude_m"),
        ("takeoff", {"altitude_datum": "sea-level", "geoid_height_m": 50.0}, "altitude_datum=takeoff"),
        (
            "sea-level",
            {"altitude_datum": "ellipsoid"},
            "It can have altitude_datum=sea-level, altitude_datum=takeoff",
        ),
    ],
)
def test_altitudes_that_cannot_be_converted_are_refused(
    scene: Callable[..., WorldFrame], datum: str, options: dict[str, Any], remedy: str
) -> None:
    wanted = MissionOptions.model_validate({"format": "qgc-wpl", **options})
    pose = _pose(1, 20).model_copy(update={"altitude_datum": AltitudeDatum(datum)})
    with pytest.raises(InvalidRequestError) as refused:
        write_mission("m", scene(datum), [MissionView(id="a", pose=pose)], (), wanted, None)
    assert remedy in refused.value.hint


def test_the_geoid_relates_sea_level_and_the_ellipsoid(scene: Callable[..., WorldFrame]) -> None:
    for datum, other, altitude in (("sea-level", "ellipsoid", 570.0), ("ellipsoid", "sea-level", 470.0)):
        options = MissionOptions.model_validate(
            {"format": "csv", "altitude_datum": other, "geoid_height_m": 50.0}
        )
        pose = _pose(1, 20).model_copy(update={"altitude_datum": AltitudeDatum(datum)})
        file = write_mission("m", scene(datum), [MissionView(id="a", pose=pose)], (), options, None)
        assert _rows(file) == [("a", altitude)]


def test_a_scene_above_takeoff_needs_nothing(scene: Callable[..., WorldFrame]) -> None:
    options = MissionOptions.model_validate({"format": "csv", "transit_height_m": 40.0})
    pose = _pose(1, -480).model_copy(update={"altitude_datum": AltitudeDatum.TAKEOFF})
    file = write_mission("m", scene("takeoff", 0.0), [MissionView(id="a", pose=pose)], (), options, None)
    assert _rows(file) == [("", 40.0), ("a", 20.0), ("", 40.0)]


def test_a_scene_without_georeference_is_refused_with_the_remedy() -> None:
    frame = WorldFrame(None, Alignment(status=AlignmentStatus.ALIGNED))
    options = MissionOptions.model_validate({"format": "csv"})
    with pytest.raises(InvalidRequestError, match="not georeferenced") as refused:
        write_mission("m", frame, [_view("a", 1, 20)], (), options, None)
    assert "Send images with GPS" in refused.value.hint
    assert "enu world" in refused.value.hint
    assert "orientation_wxyz" not in refused.value.hint


def test_formats_of_poses_refuse_what_needs_the_earth_by_name() -> None:
    world, model = (
        WorldFrame(None, Alignment(status=status))
        for status in (AlignmentStatus.ALIGNED, AlignmentStatus.MODEL)
    )
    pose = FramePose(position=(0, 0, 1), orientation_wxyz=(1, 0, 0, 0))
    views = [MissionView(id="a", pose=pose)]

    def refused(frame: WorldFrame, name: str, **options: Any) -> InvalidRequestError:
        wanted = MissionOptions.model_validate({"format": name, **options})
        with pytest.raises(InvalidRequestError) as raised:
            write_mission("m", frame, views, (), wanted, None)
        return raised.value

    assert "no metres, which ROS needs" in refused(model, "ros-posearray", **HOME).message
    for frame, name in ((model, "nerfstudio"), (world, "nerfstudio"), (world, "ros-posearray")):
        error = refused(frame, name, **HOME)
        assert error.message == "The scene is not georeferenced, so home_latitude_deg has no meaning in it."
        assert error.hint.startswith("Leave it out: ")
        assert refused(frame, name, geofence=AROUND).errors[0].field == "geofence"


def test_geojson_has_points_a_route_and_the_fence(write: Write) -> None:
    content = write([_view("a", 1, 20), _view("b", 2, 30)], **HOME, geofence=AROUND, format="geojson").content
    document = json.loads(content)
    assert document["type"] == "FeatureCollection"
    kinds = [feature["properties"]["kind"] for feature in document["features"]]
    assert kinds == ["view", "view", "route", "home", "geofence"]
    point = document["features"][0]
    assert point["geometry"] == {"type": "Point", "coordinates": [7.7501, 46.02]}
    assert point["properties"] | {"altitude_m": 20.0, "altitude_datum": "takeoff"} == point["properties"]
    (ring,) = document["features"][-1]["geometry"]["coordinates"]
    assert ring[0] == ring[-1]
    area = sum(a[0] * b[1] - b[0] * a[1] for a, b in pairwise(ring))
    assert area > 0  # counter-clockwise: RFC 7946, section 3.1.6
    above = write([_view("a", 1, 20)], format="geojson", altitude_datum="ellipsoid", geoid_height_m=50.0)
    position = json.loads(above.content)["features"][0]["geometry"]["coordinates"]
    assert position == [7.7501, 46.02, 570.0]  # its third number is above the ellipsoid


def test_views_far_from_home_are_refused_without_a_fence(write: Write) -> None:
    far = {**HOME, "home_latitude_deg": 47.02}
    with pytest.raises(
        InvalidRequestError, match="a cannot be flown: it is 111 km from home; 20 km are the most"
    ):
        write([_view("a", 1, 20)], **far)
    beyond = _view("beyond", 2700, 20)
    assert write([_view("a", 1, 20), beyond], **HOME, leave_out=True).left_out == ("beyond",)
    assert write([beyond], **{**HOME, "home_longitude_deg": 7.8}).left_out == ()
    assert write([_view("a", 1, 20), beyond]).left_out == ()  # it is in the air, who knows where
