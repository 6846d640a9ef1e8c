"""DJI's WPML in a KMZ: ``template.kml``, which ground stations edit, and ``waylines.wpml``, which is flown.

Elements, their order and ranges: https://developer.dji.com/doc/cloud-api-tutorial/en/api-reference/dji-wpml.
"""

import io
import re
import zipfile
from collections.abc import Iterator

from fvs_schema.error_codes import FieldError
from fvs_schema.missions import Drone, Finish
from fvs_schema.scenes import AltitudeDatum
from fvs_service.errors import InvalidRequestError
from fvs_service.missions.flight import Mission, Waypoint
from fvs_service.missions.formats.xml import HEAD, KML, element, text

DATUMS = frozenset({AltitudeDatum.TAKEOFF, AltitudeDatum.ELLIPSOID})
_WPML = "http://www.dji.com/wpmz/1.0.2"
_MOST_WAYPOINTS = 65_536
"""An index is at most 65,535."""
_SPEEDS_M_S = (1.0, 15.0)
_SAFE_M = (1.2, 1500.0)
"""The range of the height to which it climbs before it flies to the first waypoint."""
_USUAL_SAFE_M = 20.0
"""The height that DJI's ground stations use."""
_RETURN_M = (2.0, 1500.0)
_STOP = "toPointAndStopWithDiscontinuityCurvature"
"""Straight to a waypoint, where it stops."""
_ENUMS = {
    Drone.M30: (67, 0, 52),
    Drone.M30T: (67, 1, 53),
    Drone.M3E: (77, 0, 66),
    Drone.M3T: (77, 1, 67),
    Drone.M3M: (77, 2, 68),
    Drone.M3D: (91, 0, 80),
    Drone.M3TD: (91, 1, 81),
    Drone.M4E: (99, 0, 88),
    Drone.M4T: (99, 1, 89),
    Drone.M4D: (100, 0, 98),
    Drone.M4TD: (100, 1, 99),
    Drone.M300_H20: (60, 0, 42),
    Drone.M300_H20T: (60, 0, 43),
    Drone.M300_H20N: (60, 0, 61),
    Drone.M300_H30: (60, 0, 82),
    Drone.M300_H30T: (60, 0, 83),
    Drone.M350_H20: (89, 0, 42),
    Drone.M350_H20T: (89, 0, 43),
    Drone.M350_H20N: (89, 0, 61),
    Drone.M350_H30: (89, 0, 82),
    Drone.M350_H30T: (89, 0, 83),
}
"""DJI's numbers of the aircraft, its variant and its camera.

https://developer.dji.com/doc/cloud-api-tutorial/en/overview/product-support.html
"""
_FIRST_TIME = (1980, 1, 1, 0, 0, 0)
"""The same mission gives the same bytes."""
_READABLE = 0o644
"""What unpacked files are on Unix."""


def write(mission: Mission) -> bytes:
    """The mission as a KMZ; raises ``InvalidRequestError`` for what DJI's aircraft cannot do."""
    _check(mission)
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        for name, content in (("template.kml", _template(mission)), ("waylines.wpml", _waylines(mission))):
            file = zipfile.ZipInfo(f"wpmz/{name}", _FIRST_TIME)
            file.external_attr = _READABLE << 16
            archive.writestr(file, content, compress_type=zipfile.ZIP_DEFLATED)
    return out.getvalue()


def _check(mission: Mission) -> None:
    low, high = _SPEEDS_M_S
    if not low <= mission.options.speed_m_s <= high:
        raise InvalidRequestError(
            f"DJI's aircraft fly missions at {low:g} to {high:g} m/s, not at {mission.options.speed_m_s:g}.",
            hint=f"Choose a speed_m_s from {low:g} to {high:g}.",
            errors=[FieldError("speed_m_s", f"it is not from {low:g} to {high:g}")],
        )
    highest_m = mission.options.highest_height_m
    if highest_m is not None and highest_m < _RETURN_M[0]:
        raise InvalidRequestError(
            f"DJI's aircraft come back at {_RETURN_M[0]:g} m or higher, and the highest is {highest_m:g} m.",
            hint=f"Choose a highest_height_m of {_RETURN_M[0]:g} or more.",
            errors=[FieldError("highest_height_m", f"it is less than {_RETURN_M[0]:g}")],
        )
    if len(mission.waypoints) > _MOST_WAYPOINTS:
        count = len(mission.waypoints)
        raise InvalidRequestError(
            f"The mission has {count} waypoints; DJI's format has room for {_MOST_WAYPOINTS}.",
            hint="Ask for fewer views.",
        )
    if not _relative(mission) and mission.options.geoid_height_m is None:
        raise InvalidRequestError(
            "DJI's template has altitudes above sea level beside those above the ellipsoid.",
            hint="Give geoid_height_m, the height of the geoid above the ellipsoid at the site; or "
            "home_altitude_m, for altitudes above home.",
        )


def _relative(mission: Mission) -> bool:
    return mission.datum is AltitudeDatum.TAKEOFF


def _document(*content: str) -> str:
    return f'{HEAD}<kml xmlns="{KML}" xmlns:wpml="{_WPML}">{element("Document", *content)}</kml>\n'


def _wpml(tag: str, *content: str | float) -> str:
    return element(f"wpml:{tag}", *content)


def _template(mission: Mission) -> str:
    heights = [_height(mission, waypoint) for waypoint in mission.waypoints]
    folder = element(
        "Folder",
        _wpml("templateType", "waypoint"),
        _wpml("templateId", "0"),
        _wpml(
            "waylineCoordinateSysParam",
            _wpml("coordinateMode", "WGS84"),
            _wpml("heightMode", _height_mode(mission)),
        ),
        _wpml("autoFlightSpeed", mission.options.speed_m_s),
        _wpml("globalHeight", heights[0]),
        _wpml("gimbalPitchMode", "usePointSetting"),
        _wpml("globalWaypointHeadingParam", *_heading(mission.waypoints[0])),
        _wpml("globalWaypointTurnMode", _STOP),
        _wpml("globalUseStraightLine", "1"),
        *(
            _placemark(
                number,
                waypoint,
                _wpml("ellipsoidHeight", waypoint.altitude_m),
                _wpml("height", height_m),
                _wpml("useGlobalHeight", "0"),
                _wpml("useGlobalSpeed", "1"),
                _wpml("useGlobalHeadingParam", "0"),
                _wpml("waypointHeadingParam", *_heading(waypoint)),
                _wpml("useGlobalTurnParam", "1"),
                _wpml("gimbalPitchAngle", waypoint.pitch_deg),
                *_actions(mission, number, waypoint),
            )
            for number, (waypoint, height_m) in enumerate(zip(mission.waypoints, heights, strict=True))
        ),
    )
    return _document(_wpml("author", "fvs"), _config(mission), folder)


def _waylines(mission: Mission) -> str:
    folder = element(
        "Folder",
        _wpml("templateId", "0"),
        _wpml("executeHeightMode", "relativeToStartPoint" if _relative(mission) else "WGS84"),
        _wpml("waylineId", "0"),
        _wpml("autoFlightSpeed", mission.options.speed_m_s),
        *(
            _placemark(
                number,
                waypoint,
                _wpml("executeHeight", waypoint.altitude_m),
                _wpml("waypointSpeed", mission.options.speed_m_s),
                _wpml("waypointHeadingParam", *_heading(waypoint)),
                _wpml(
                    "waypointTurnParam",
                    _wpml("waypointTurnMode", _STOP),
                    _wpml("waypointTurnDampingDist", "0"),
                ),
                _wpml("useStraightLine", "1"),
                *_actions(mission, number, waypoint),
            )
            for number, waypoint in enumerate(mission.waypoints)
        ),
    )
    return _document(_config(mission), folder)


def _config(mission: Mission) -> str:
    options = mission.options
    aircraft, variant, camera = _ENUMS[options.drone]
    returns = options.finish is Finish.RETURN
    highest_m = max(waypoint.altitude_m for waypoint in mission.waypoints)
    # Without a transit height it returns as high as the mission goes, if that is known above home.
    return_m = options.transit_height_m or (highest_m if _relative(mission) else None)
    safe_m = options.transit_height_m or _USUAL_SAFE_M
    if options.highest_height_m is not None:
        safe_m = min(safe_m, options.highest_height_m)
    return _wpml(
        "missionConfig",
        _wpml("flyToWaylineMode", "safely"),
        _wpml("finishAction", "goHome" if returns else "noAction"),
        _wpml("exitOnRCLost", "executeLostAction"),
        _wpml("executeRCLostAction", "goBack"),
        _wpml("takeOffSecurityHeight", _clamped(safe_m, _SAFE_M)),
        _wpml("globalTransitionalSpeed", options.speed_m_s),
        *([] if return_m is None else [_wpml("globalRTHHeight", _clamped(return_m, _RETURN_M))]),
        _wpml("droneInfo", _wpml("droneEnumValue", aircraft), _wpml("droneSubEnumValue", variant)),
        _wpml("payloadInfo", _wpml("payloadEnumValue", camera), _wpml("payloadPositionIndex", "0")),
    )


def _placemark(number: int, waypoint: Waypoint, *content: str) -> str:
    position = f"{waypoint.longitude_deg:.9f},{waypoint.latitude_deg:.9f}"
    return element(
        "Placemark", element("Point", element("coordinates", position)), _wpml("index", number), *content
    )


def _heading(waypoint: Waypoint) -> Iterator[str]:
    """It turns on the way, and has its yaw, in whole degrees, when it arrives."""
    yield _wpml("waypointHeadingMode", "smoothTransition")
    # An integer before version 1.10 of DJI's Cloud API, a float since: an integer is right in both.
    yield _wpml("waypointHeadingAngle", round((waypoint.yaw_deg + 180.0) % 360.0 - 180.0))
    yield _wpml("waypointPoiPoint", "0.000000,0.000000,0.000000")
    yield _wpml("waypointHeadingPathMode", "followBadArc")


def _actions(mission: Mission, number: int, waypoint: Waypoint) -> Iterator[str]:
    """The actions at a view: turn the gimbal, hold still for more than 0 s, take a photograph."""
    if waypoint.name is None:
        return
    actions = (
        ("gimbalRotate", _gimbal(waypoint)),
        *([("hover", (_wpml("hoverTime", mission.options.hold_s),))] if mission.options.hold_s > 0.0 else ()),
        ("takePhoto", _photograph(waypoint.name)),
    )
    yield _wpml(
        "actionGroup",
        _wpml("actionGroupId", number),
        _wpml("actionGroupStartIndex", number),
        _wpml("actionGroupEndIndex", number),
        _wpml("actionGroupMode", "sequence"),
        _wpml("actionTrigger", _wpml("actionTriggerType", "reachPoint")),
        *(
            _wpml(
                "action",
                _wpml("actionId", place),
                _wpml("actionActuatorFunc", function),
                _wpml("actionActuatorFuncParam", *parameters),
            )
            for place, (function, parameters) in enumerate(actions)
        ),
    )


def _gimbal(waypoint: Waypoint) -> tuple[str, ...]:
    return (
        _wpml("gimbalHeadingYawBase", "north"),
        _wpml("gimbalRotateMode", "absoluteAngle"),
        _wpml("gimbalPitchRotateEnable", "1"),
        _wpml("gimbalPitchRotateAngle", waypoint.pitch_deg),
        _wpml("gimbalRollRotateEnable", "0"),
        _wpml("gimbalRollRotateAngle", "0"),
        _wpml("gimbalYawRotateEnable", "0"),
        _wpml("gimbalYawRotateAngle", "0"),
        _wpml("gimbalRotateTimeEnable", "0"),
        _wpml("gimbalRotateTime", "0"),
        _wpml("payloadPositionIndex", "0"),
    )


def _photograph(name: str) -> tuple[str, ...]:
    return (
        _wpml("fileSuffix", text(re.sub(r"[^A-Za-z0-9_-]", "-", name))),
        _wpml("payloadPositionIndex", "0"),
        _wpml("useGlobalPayloadLensIndex", "0"),
        _wpml("payloadLensIndex", "wide"),
    )


def _height_mode(mission: Mission) -> str:
    if mission.options.above_ground:
        return "aboveGroundLevel"
    return "relativeToStartPoint" if _relative(mission) else "EGM96"


def _height(mission: Mission, waypoint: Waypoint) -> float:
    """The height of a waypoint for the template: above the ground, home or sea level."""
    if mission.options.above_ground:
        assert waypoint.above_ground_m is not None, "waypoints without terrain were refused"
        return waypoint.above_ground_m
    geoid_m = 0.0 if _relative(mission) else mission.options.geoid_height_m or 0.0
    return waypoint.altitude_m - geoid_m


def _clamped(value: float, limits: tuple[float, float]) -> float:
    return min(max(value, limits[0]), limits[1])
