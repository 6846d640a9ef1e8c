"""The picture to brief a pilot with."""

import re
from typing import Any
from xml.etree import ElementTree

import pytest
from fvs_service.missions.writing import write_mission
from fvs_service.scenes.poses import WorldFrame

from fvs_schema.missions import MissionOptions, MissionView
from fvs_schema.poses import VehiclePose
from fvs_schema.scenes import Alignment, AlignmentStatus, Origin
from fvs_schema.terrain import Terrain

SVG = "{http://www.w3.org/2000/svg}"
HOME = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 500.0}
FENCE = "46.0197,7.7495;46.0203,7.7495;46.0203,7.7515;46.0197,7.7515"


def _view(name: str, east: float, height: float, yaw: float = 90.0, pitch: float = -30.0) -> MissionView:
    pose = VehiclePose(
        latitude_deg=46.02,
        longitude_deg=7.75 + 1e-4 * east,
        altitude_m=500.0 + height,
        yaw_deg=yaw,
        pitch_deg=pitch,
    )
    return MissionView(id=name, pose=pose)


VIEWS = (_view("first", 4, 20), _view("down", 8, 26, pitch=-90.0), _view("c", 12, 20, yaw=0.0))


def _picture(views: Any = VIEWS, terrain: Terrain | None = None, **options: Any) -> ElementTree.Element:
    origin = Origin(latitude_deg=46.02, longitude_deg=7.75, altitude_m=500.0)
    frame = WorldFrame(origin, Alignment(status=AlignmentStatus.ALIGNED))
    wanted = MissionOptions.model_validate({"format": "briefing", **options})
    return ElementTree.fromstring(write_mission("m", frame, views, (), wanted, None, terrain=terrain).content)


def _texts(picture: ElementTree.Element) -> list[str]:
    return [text.text or "" for text in picture.iter(f"{SVG}text")]


def _of(picture: ElementTree.Element, kind: str) -> list[ElementTree.Element]:
    return [one for one in picture.iter() if one.get("class", "").split(" ")[0] == kind]


def test_it_has_the_legs_in_order_with_heights_ways_and_times() -> None:
    texts = _texts(_picture(**HOME, lowest_height_m=5.0, highest_height_m=40.0, geofence=FENCE))
    assert texts[:4] == [
        "m",
        "3 views, 227 m, about 2:18 min at 5 m/s, 4 s at a view",
        "home 46.020000, 7.750000; at the end: return; views at 20.0 to 26.0 m above home",
        "lowest 5 m; highest 40 m; geofence: dashed",
    ]
    table = texts[texts.index("no.") :]
    assert table[: table.index("home")] == [
        *("no.", "to", "above home", "way", "min", "since start", "heading", "gimbal")
    ]
    first = table.index("first")
    assert [table[first - 1], *table[first + 1 : first + 7]] == [
        *("1", "20.0 m", "31 m", "0:21", "0:34", "90°", "−30°")
    ]
    assert table[-5:] == ["home", "0.0 m", "20 m", "0:39", "2:18"]


def test_the_map_shows_where_views_look_and_what_to_stay_inside_of() -> None:
    picture = _picture(**HOME, geofence=FENCE)
    assert [len(_of(picture, kind)) for kind in ("tip", "fence", "home")] == [2, 1, 0]
    (ring,) = [one for one in _of(picture, "looks") if one.tag == f"{SVG}circle"]
    east, north = [one for one in _of(picture, "looks") if one.tag == f"{SVG}line"]
    assert ring.get("r") == "13"
    assert float(east.attrib["x2"]) > float(east.attrib["x1"]) + 20.0
    assert float(east.attrib["y2"]) == pytest.approx(float(east.attrib["y1"]))
    assert float(north.attrib["y2"]) < float(north.attrib["y1"]) - 20.0  # up is north
    (fence,) = _of(picture, "fence")
    corners = [float(number) for number in re.split("[ ,]", fence.attrib["points"])]
    assert 0.0 < min(corners) < max(corners[::2]) < 840.0
    far = _picture(**HOME, geofence="45.9,7.6;46.1,7.6;46.1,7.9;45.9,7.9")
    views = [float(one.attrib["cx"]) for one in _of(far, "view") if one.get("r") == "9"]
    assert max(views) - min(views) > 300.0  # the way still fills the map


def test_the_ground_is_in_the_profile_and_the_table() -> None:
    terrain = Terrain(
        south_deg=46.019,
        west_deg=7.749,
        latitude_step_deg=1e-3,
        longitude_step_deg=1e-3,
        columns=4,
        heights_m=(500.0, 500.0, 510.0, 510.0) * 3,
    )
    picture = _picture(terrain=terrain, **HOME, lowest_height_m=2.0, above_ground=True)
    assert len(_of(picture, "ground")) == 1
    texts = _texts(picture)
    assert "above ground" in texts
    assert "lowest 2 m above the ground; no geofence" in texts
    assert "16.0 m" in texts  # 20 m above home


@pytest.mark.parametrize("options", [{}, {"finish": "hold", **HOME}, {"takeoff": False, **HOME}])
def test_one_view_and_no_home_are_drawn_too(options: dict[str, Any]) -> None:
    texts = _texts(_picture(VIEWS[:1], **options))
    assert any(text.startswith("1 view,") for text in texts)


def test_a_part_says_which_battery_it_is_for() -> None:
    texts = _texts(_picture(**HOME, battery_s=160.0, part=2))
    assert texts[0] == "m-2-of-3"
    assert "one battery 2:40 min, landing with 30%" in texts[3]


def test_many_missions_are_drawn(flights: Any) -> None:
    for flight in flights[:100]:
        texts = _texts(ElementTree.fromstring(flight.write(format="briefing")))
        assert [view.id for view in flight.views if view.id not in texts] == []
        assert not {"nan", "inf"} & {word for text in texts for word in text.split()}
