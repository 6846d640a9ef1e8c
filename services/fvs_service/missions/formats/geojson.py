"""GeoJSON (RFC 7946): a point for each waypoint, the route, and the geofence.

Its third coordinate is the height above the ellipsoid, so positions have one only there.
"""

from collections.abc import Sequence
from itertools import groupby, pairwise
from typing import Any

import orjson

from fvs_schema.fence import Place
from fvs_schema.scenes import AltitudeDatum
from fvs_service.missions.flight import Mission, Waypoint

_DECIMALS = 9
"""A tenth of a millimetre."""


def write(mission: Mission) -> bytes:
    """The mission as a feature collection."""
    features = [_point(mission, number, point) for number, point in enumerate(mission.waypoints, start=1)]
    features.append(_feature(_route([point.place for point in mission.waypoints]), {"kind": "route"}))
    if mission.home is not None:
        position = _position((mission.home.latitude_deg, mission.home.longitude_deg))
        features.append(_feature({"type": "Point", "coordinates": position}, {"kind": "home"}))
    if mission.options.fence is not None:
        features.append(_feature(_area(mission.options.fence.corners), {"kind": "geofence"}))
    return orjson.dumps({"type": "FeatureCollection", "features": features})


def _point(mission: Mission, number: int, point: Waypoint) -> dict[str, Any]:
    above = [round(point.altitude_m, 4)] if mission.datum is AltitudeDatum.ELLIPSOID else []
    options = mission.options
    properties = {
        "kind": "pass" if point.name is None else "view",
        "number": number,
        "id": point.name,
        "altitude_m": round(point.altitude_m, 4),
        "altitude_datum": mission.datum,
        "yaw_deg": round(point.yaw_deg, 4),
        "pitch_deg": round(point.pitch_deg, 4),
        "roll_deg": round(point.roll_deg, 4),
        "speed_m_s": options.speed_m_s,
        "acceptance_radius_m": options.acceptance_radius_m,
        "hold_s": 0.0 if point.name is None else options.hold_s,
    }
    return _feature({"type": "Point", "coordinates": _position(point.place) + above}, properties)


def _feature(geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _position(place: Place) -> list[float]:
    return [round(place[1], _DECIMALS), round(place[0], _DECIMALS)]


def _route(places: Sequence[Place]) -> dict[str, Any]:
    """A line through places, in pieces that meet at the antimeridian (RFC 7946, section 3.1.9)."""
    pieces = [[places[0]]]
    for before, after in pairwise(places):
        east_deg = after[1] - before[1]
        if abs(east_deg) > 180.0:
            edge = 180.0 if east_deg < 0.0 else -180.0
            on_the_way = east_deg + 2.0 * edge  # 0 along the antimeridian, whose longitude has two signs
            share = (edge - before[1]) / on_the_way if on_the_way else 0.0
            latitude_deg = before[0] + share * (after[0] - before[0])
            pieces[-1].append((latitude_deg, edge))
            pieces.append([(latitude_deg, -edge)])
        pieces[-1].append(after)
    lines = [_line(piece) for piece in pieces]
    # A piece of one position is where a route only touches the antimeridian, or all of a route to one view.
    lines = [line for line in lines if len(line) > 1] or [lines[0] * 2]
    if len(lines) == 1:
        return {"type": "LineString", "coordinates": lines[0]}
    return {"type": "MultiLineString", "coordinates": lines}


def _line(places: Sequence[Place]) -> list[list[float]]:
    """The positions of places, without those that are where the one before is."""
    return [position for position, _ in groupby(map(_position, places))]


def _area(corners: Sequence[Place]) -> dict[str, Any]:
    """A polygon, counter-clockwise; across the antimeridian its longitudes go on beyond 180."""
    west_deg = corners[0][1]
    ring = [
        (latitude_deg, west_deg + (longitude_deg - west_deg + 180.0) % 360.0 - 180.0)
        for latitude_deg, longitude_deg in corners
    ]
    ring.append(ring[0])
    area = sum(a[1] * b[0] - b[1] * a[0] for a, b in pairwise(ring))
    ordered = ring if area > 0.0 else ring[::-1]
    return {"type": "Polygon", "coordinates": [[_position(corner) for corner in ordered]]}
