"""KML 2.2 for Google Earth: a point for each waypoint, with the camera of a view, the route, the geofence.

https://developers.google.com/kml/documentation/kmlreference. Altitudes are above sea level or the ground.
"""

from collections.abc import Iterator, Sequence

from fvs_schema.fence import Place
from fvs_schema.scenes import AltitudeDatum
from fvs_service.missions.flight import Mission, Waypoint
from fvs_service.missions.formats.xml import HEAD, KML, element, text

DATUMS = frozenset({AltitudeDatum.SEA_LEVEL})
_TO_THE_GROUND = element("extrude", 1)
_ON_THE_GROUND = element("tessellate", 1)


def write(mission: Mission) -> bytes:
    """The mission as a document, whose cameras show in Google Earth what the views will see."""
    content = element(
        "Document",
        element("name", text(mission.name)),
        *_points(mission),
        *_home(mission),
        _route(mission),
        *_geofence(mission),
    )
    return f'{HEAD}<kml xmlns="{KML}">{content}</kml>\n'.encode()


def _points(mission: Mission) -> Iterator[str]:
    for number, waypoint in enumerate(mission.waypoints, start=1):
        point = element("Point", _TO_THE_GROUND, _mode(mission), _coordinates(mission, [waypoint]))
        if waypoint.name is None:
            yield element("Placemark", element("name", f"{number}"), point)
        else:
            name = element("name", text(f"{number} {waypoint.name}"))
            yield element("Placemark", name, _camera(mission, waypoint), point)


def _camera(mission: Mission, view: Waypoint) -> str:
    return element(
        "Camera",
        element("longitude", view.longitude_deg),
        element("latitude", view.latitude_deg),
        element("altitude", _altitude(mission, view)),
        element("heading", view.yaw_deg),
        element("tilt", 90.0 + view.pitch_deg),  # 0 is down
        _mode(mission),
    )


def _home(mission: Mission) -> Iterator[str]:
    if mission.home is not None:
        place = (mission.home.latitude_deg, mission.home.longitude_deg)
        point = element("Point", element("coordinates", _on_ground([place])))
        yield element("Placemark", element("name", "home"), point)


def _route(mission: Mission) -> str:
    line = element("LineString", _TO_THE_GROUND, _mode(mission), _coordinates(mission, mission.waypoints))
    return element("Placemark", element("name", "route"), line)


def _geofence(mission: Mission) -> Iterator[str]:
    if (fence := mission.options.fence) is not None:
        corners = [*fence.corners, fence.corners[0]]
        ring = element("LinearRing", element("coordinates", _on_ground(corners)))
        area = element("Polygon", _ON_THE_GROUND, element("outerBoundaryIs", ring))
        yield element("Placemark", element("name", "geofence"), area)


def _mode(mission: Mission) -> str:
    return element("altitudeMode", "relativeToGround" if mission.options.above_ground else "absolute")


def _altitude(mission: Mission, waypoint: Waypoint) -> float:
    if mission.options.above_ground:
        assert waypoint.above_ground_m is not None, "waypoints without terrain were refused"
        return waypoint.above_ground_m
    return waypoint.altitude_m


def _coordinates(mission: Mission, waypoints: Sequence[Waypoint]) -> str:
    places = (
        f"{point.longitude_deg:.9f},{point.latitude_deg:.9f},{_altitude(mission, point):.4f}"
        for point in waypoints
    )
    return element("coordinates", " ".join(places))


def _on_ground(places: Sequence[Place]) -> str:
    return " ".join(f"{longitude_deg:.9f},{latitude_deg:.9f}" for latitude_deg, longitude_deg in places)
