"""DJI's KMZ, read by an XML parser: namespaces, the order of elements, ranges, and where it leads."""

import io
import re
import zipfile
from typing import Any
from xml.etree.ElementTree import Element

import pytest
from defusedxml.ElementTree import fromstring
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.formats.xml import element
from fvs_service.missions.writing import write_mission

from fvs_schema.missions import Drone, MissionOptions, MissionView
from fvs_schema.poses import VehiclePose

KML, WPML = "{http://www.opengis.net/kml/2.2}", "{http://www.dji.com/wpmz/1.0.2}"
CONFIG = [
    *("flyToWaylineMode", "finishAction", "exitOnRCLost", "executeRCLostAction", "takeOffSecurityHeight"),
    *("globalTransitionalSpeed", "globalRTHHeight", "droneInfo", "payloadInfo"),
]
HEADING = ["waypointHeadingMode", "waypointHeadingAngle", "waypointPoiPoint", "waypointHeadingPathMode"]
GROUP = ["actionGroupId", "actionGroupStartIndex", "actionGroupEndIndex", "actionGroupMode", "actionTrigger"]
TEMPLATE = [
    *("templateType", "templateId", "waylineCoordinateSysParam", "autoFlightSpeed", "globalHeight"),
    *("gimbalPitchMode", "globalWaypointHeadingParam", "globalWaypointTurnMode", "globalUseStraightLine"),
]
TEMPLATE_POINT = [
    *("Point", "index", "ellipsoidHeight", "height", "useGlobalHeight", "useGlobalSpeed"),
    *("useGlobalHeadingParam", "waypointHeadingParam", "useGlobalTurnParam", "gimbalPitchAngle"),
]
WAYLINE = ["templateId", "executeHeightMode", "waylineId", "autoFlightSpeed"]
WAYLINE_POINT = [
    *("Point", "index", "executeHeight", "waypointSpeed", "waypointHeadingParam", "waypointTurnParam"),
    "useStraightLine",
]


def _documents(content: bytes) -> tuple[Element, Element]:
    """The Documents of template.kml and waylines.wpml."""
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        assert archive.testzip() is None
        assert archive.namelist() == ["wpmz/template.kml", "wpmz/waylines.wpml"]
        roots = [fromstring(archive.read(name)) for name in archive.namelist()]
    for root in roots:
        assert root.tag == f"{KML}kml"
        assert [child.tag for child in root] == [f"{KML}Document"]
    return roots[0][0], roots[1][0]


def _names(element: Element) -> list[str]:
    return [child.tag.rpartition("}")[2] for child in element]


def _text(element: Element, *path: str) -> str:
    found = element.findtext("/".join(f"{WPML}{name}" for name in path))
    assert found is not None, path
    return found


def _place(placemark: Element) -> tuple[float, float]:
    longitude, latitude = placemark.findtext(f"{KML}Point/{KML}coordinates", "").split(",")
    assert -180 <= float(longitude) <= 180
    return float(latitude), float(longitude)


def _actions(placemark: Element) -> list[Element]:
    return placemark.findall(f"{WPML}actionGroup/{WPML}action")


def test_many_missions_come_back_from_the_waylines(flights: Any, errors: Any) -> None:
    for flight in flights:
        _, document = _documents(flight.write(format="dji-kmz"))
        marks = document.findall(f"{KML}Folder/{KML}Placemark")
        views = [mark for mark in marks if _actions(mark)]
        assert [int(_text(mark, "index")) for mark in marks] == list(range(len(marks)))
        for view, mark in zip(flight.views, views, strict=True):
            gimbal = _actions(mark)[0].find(f"{WPML}actionActuatorFuncParam")
            assert gimbal is not None
            altitude = float(_text(mark, "executeHeight")) - flight.to_takeoff_m
            yaw = int(_text(mark, "waypointHeadingParam", "waypointHeadingAngle"))
            assert -180 <= yaw <= 180
            errors.add(
                flight, view, (*_place(mark), altitude), yaw, float(_text(gimbal, "gimbalPitchRotateAngle"))
            )
    errors.check("DJI waylines.wpml", degrees=0.5)


def test_elements_are_in_djis_order_and_namespaces(flights: Any) -> None:
    for flight in flights[:50]:
        template, waylines = _documents(flight.write(format="dji-kmz"))
        assert _names(template) == ["author", "missionConfig", "Folder"]
        assert _names(waylines) == ["missionConfig", "Folder"]
        for document in (template, waylines):
            config = document.find(f"{WPML}missionConfig")
            assert config is not None
            assert _names(config) == CONFIG
            for part in document.iter():
                of_kml = part.tag.rpartition("}")[2] in (
                    *("Document", "Folder", "Placemark", "Point", "coordinates"),
                )
                assert part.tag.startswith(KML if of_kml else WPML), part.tag
        for document, start, inside in (
            (template, TEMPLATE, TEMPLATE_POINT),
            (waylines, WAYLINE, WAYLINE_POINT),
        ):
            folder = document.find(f"{KML}Folder")
            assert folder is not None
            marks = folder.findall(f"{KML}Placemark")
            assert _names(folder) == start + ["Placemark"] * len(marks)
            for mark in marks:
                found = _names(mark)
                assert found in (inside, [*inside, "actionGroup"])
                heading = mark.find(f"{WPML}waypointHeadingParam")
                assert heading is not None
                assert _names(heading) == HEADING
                if found[-1] == "actionGroup":
                    group = mark.find(f"{WPML}actionGroup")
                    assert group is not None
                    assert _names(group) == [*GROUP, "action", "action", "action"]
                    assert _text(group, "actionGroupStartIndex") == _text(mark, "index")
                    functions = [_text(action, "actionActuatorFunc") for action in _actions(mark)]
                    assert functions == ["gimbalRotate", "hover", "takePhoto"]
        places = [
            [_place(mark) for mark in document.iter(f"{KML}Placemark")] for document in (template, waylines)
        ]
        assert places[0] == places[1]


def test_settings_are_in_the_file(flights: Any) -> None:
    options = {"speed_m_s": 7.5, "hold_s": 2.0, "transit_height_m": 60.0, "finish": "hold", "drone": "m30t"}
    template, waylines = _documents(flights[0].write(format="dji-kmz", **options))
    for document in (template, waylines):
        config = document.find(f"{WPML}missionConfig")
        assert config is not None
        assert _text(config, "finishAction") == "noAction"
        assert _text(config, "exitOnRCLost") == "executeLostAction"  # it comes back
        assert _text(config, "executeRCLostAction") == "goBack"
        assert float(_text(config, "takeOffSecurityHeight")) == 60.0
        assert float(_text(config, "globalTransitionalSpeed")) == 7.5
        assert _text(config, "droneInfo", "droneEnumValue") == "67"
        assert _text(config, "droneInfo", "droneSubEnumValue") == "1"
        assert _text(config, "payloadInfo", "payloadEnumValue") == "53"
        hovers = [float(found.text or "") for found in document.iter(f"{WPML}hoverTime")]
        assert hovers == [2.0] * len(flights[0].views)
    for document in _documents(flights[0].write(format="dji-kmz", hold_s=0.0)):
        assert document.find(f".//{WPML}hoverTime") is None  # more than 0 s
    folder = waylines.find(f"{KML}Folder")
    assert folder is not None
    assert _text(folder, "executeHeightMode") == "relativeToStartPoint"
    assert _text(folder, "autoFlightSpeed") == "7.5"


# https://developer.dji.com/doc/cloud-api-tutorial/en/overview/product-support.html
ENUMS = {
    "m30": ("67", "0", "52"),
    "m30t": ("67", "1", "53"),
    "m3e": ("77", "0", "66"),
    "m3t": ("77", "1", "67"),
    "m3m": ("77", "2", "68"),
    "m3d": ("91", "0", "80"),
    "m3td": ("91", "1", "81"),
    "m4e": ("99", "0", "88"),
    "m4t": ("99", "1", "89"),
    "m4d": ("100", "0", "98"),
    "m4td": ("100", "1", "99"),
    "m300-h20": ("60", "0", "42"),
    "m300-h20t": ("60", "0", "43"),
    "m300-h20n": ("60", "0", "61"),
    "m300-h30": ("60", "0", "82"),
    "m300-h30t": ("60", "0", "83"),
    "m350-h20": ("89", "0", "42"),
    "m350-h20t": ("89", "0", "43"),
    "m350-h20n": ("89", "0", "61"),
    "m350-h30": ("89", "0", "82"),
    "m350-h30t": ("89", "0", "83"),
}


@pytest.mark.parametrize("drone", [one.value for one in Drone])
def test_aircraft_and_cameras_have_djis_numbers(flights: Any, drone: str) -> None:
    for document in _documents(flights[0].write(format="dji-kmz", drone=drone)):
        config = document.find(f"{WPML}missionConfig")
        assert config is not None
        numbers = (
            _text(config, "droneInfo", "droneEnumValue"),
            _text(config, "droneInfo", "droneSubEnumValue"),
            _text(config, "payloadInfo", "payloadEnumValue"),
        )
        assert numbers == ENUMS[drone]


@pytest.mark.parametrize(
    ("options", "safe_m"),
    [
        ({}, 20.0),
        ({"highest_height_m": 120.0}, 20.0),
        ({"highest_height_m": 15.0}, 15.0),
        ({"highest_height_m": 2.0}, 2.0),
        ({"transit_height_m": 60.0}, 60.0),
        ({"transit_height_m": 60.0, "highest_height_m": 60.0}, 60.0),
        ({"transit_height_m": 8.0, "highest_height_m": 60.0}, 8.0),
        ({"transit_height_m": 1.0}, 1.2),
        ({"transit_height_m": 2000.0}, 1500.0),
    ],
)
def test_it_climbs_to_a_safe_height_within_the_height_band(
    scene: Any, options: dict[str, float], safe_m: float
) -> None:
    for document in _documents(_low(scene, **options)):
        config = document.find(f"{WPML}missionConfig")
        assert config is not None
        assert float(_text(config, "takeOffSecurityHeight")) == safe_m
        highest = options.get("highest_height_m", 1500.0)
        assert 2.0 <= float(_text(config, "globalRTHHeight")) <= highest


def test_a_height_band_that_djis_aircraft_cannot_keep_is_refused(scene: Any) -> None:
    with pytest.raises(InvalidRequestError, match="come back at 2 m or higher") as refused:
        _low(scene, highest_height_m=1.9)
    assert [error.field for error in refused.value.errors] == ["highest_height_m"]


def _low(scene: Any, **options: Any) -> bytes:
    """A mission to a view 1.5 m above home."""
    place = {"latitude_deg": 46.0201, "longitude_deg": 7.7501, "altitude_m": 501.5}
    view = MissionView(id="a", pose=VehiclePose(**place, yaw_deg=180.0000001, pitch_deg=-1e-8))
    home = {"home_latitude_deg": 46.02, "home_longitude_deg": 7.75, "home_altitude_m": 500.0}
    wanted = MissionOptions.model_validate({"format": "dji-kmz", **home, **options})
    return write_mission("m", scene(), [view], (), wanted, None).content


def test_numbers_have_no_exponents(scene: Any) -> None:
    """XML Schema's decimals have none, and DJI's own files neither."""
    for document in _documents(_low(scene)):
        values = [element.text or "" for element in document.iter() if not len(element)]
        numbers = [value for value in values if re.fullmatch(r"[-+0-9.eE]+", value)]
        assert len(numbers) > 20
        assert [value for value in numbers if not re.fullmatch(r"-?\d+(\.\d+)?", value)] == []
        assert "-0" not in numbers
    for value, written in (
        (-1e-12, "0"),
        (1e-8, "0.00000001"),
        (-180.0, "-180"),
        (7, "7"),
        (1e10, f"1{'0' * 10}"),
    ):
        assert element("a", value) == f"<a>{written}</a>"


def test_altitudes_above_the_ellipsoid_come_with_those_above_sea_level(flights: Any) -> None:
    flight = next(one for one in flights if one.origin.altitude_datum == "ellipsoid")
    content = flight.write(format="dji-kmz", altitude_datum="ellipsoid", geoid_height_m=47.0)
    template, waylines = _documents(content)
    assert next(waylines.iter(f"{WPML}executeHeightMode")).text == "WGS84"
    assert next(template.iter(f"{WPML}heightMode")).text == "EGM96"
    for mark, flown in zip(template.iter(f"{KML}Placemark"), waylines.iter(f"{KML}Placemark"), strict=True):
        above = float(_text(mark, "ellipsoidHeight"))
        assert above == float(_text(flown, "executeHeight"))
        assert above - float(_text(mark, "height")) == pytest.approx(47.0, abs=1e-5)
    with pytest.raises(InvalidRequestError, match="sea level beside those above the ellipsoid") as refused:
        flight.write(format="dji-kmz", altitude_datum="ellipsoid")
    assert "geoid_height_m" in refused.value.hint


def test_what_djis_aircraft_cannot_do_is_refused(flights: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    for speed in (0.5, 16.0):
        with pytest.raises(InvalidRequestError, match="at 1 to 15 m/s") as refused:
            flights[0].write(format="dji-kmz", speed_m_s=speed)
        assert [error.field for error in refused.value.errors] == ["speed_m_s"]
    monkeypatch.setattr("fvs_service.missions.formats.dji_kmz._MOST_WAYPOINTS", 3)
    flight = next(one for one in flights if len(one.views) == 5)
    with pytest.raises(InvalidRequestError, match="DJI's format has room for 3") as refused:
        flight.write(format="dji-kmz")
    assert "fewer views" in refused.value.hint


def test_the_same_mission_gives_the_same_bytes(flights: Any) -> None:
    assert flights[0].write(format="dji-kmz") == flights[0].write(format="dji-kmz")
