"""Cameras and what they see of the ground, as GeoJSON. Source: RFC 7946."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from fvs_engine.export.placement import Placement
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.geometry.geodetic import attitude_of
from fvs_engine.views import PinholeView
from fvs_schema.scenes import AltitudeDatum

Array = NDArray[np.float64]

_REACH = 2.0
"""How far a view of the ground reaches at most, in distances of the farthest points that it shows."""
_FARTHEST_PERCENTILE = 95.0
"""Sparse points have far outliers."""
_POLAR_DEG = 85.0
"""Latitude from which edges, straight on the ground, are no longer straight in degrees."""
_POLAR_PARTS = 32


def write_footprints(path: Path, views: Sequence[PinholeView], points: Array, placement: Placement) -> None:
    """Write for each view a point, where its camera is, and a polygon, what it shows of the ground.

    The ground is level, at the median height of those sparse ``points`` [P, 3] (model frame) that are in
    the image; a view to the horizon ends at twice their distance. Raises ``StorageError``.
    """
    in_world = placement.world_from_model.apply(points)
    features = [feature for view in views for feature in _features(view, points, in_world, placement)]
    document = {"type": "FeatureCollection", "features": features}
    write_text_atomically(path, json.dumps(document, indent=1) + "\n")


def _features(
    view: PinholeView, points: Array, in_world: Array, placement: Placement
) -> list[dict[str, Any]]:
    world_from_camera = placement.world_from_model.move_camera(view.camera_from_model.inverse())
    ((latitude, longitude, altitude),) = placement.geodetic(world_from_camera.translation[None]).tolist()
    yaw_deg, pitch_deg, roll_deg = attitude_of(world_from_camera)
    datum = placement.origin.altitude_datum
    # Heights in GeoJSON are above the ellipsoid.
    where = [longitude, latitude, *([altitude] if datum is AltitudeDatum.ELLIPSOID else [])]
    camera = {
        "altitude_m": altitude,
        "altitude_datum": datum.value,
        "yaw_deg": yaw_deg,
        "pitch_deg": pitch_deg,
        "roll_deg": roll_deg,
    }
    corners = _footprint(view, world_from_camera.rotation, points, in_world, placement)
    rings = split_at_antimeridian(placement.geodetic(corners)[:, [1, 0]])
    return [
        _feature(view.name, "camera", {"type": "Point", "coordinates": where}, camera),
        _feature(view.name, "footprint", _polygons(rings), {}),
    ]


def _feature(name: str, kind: str, geometry: dict[str, Any], properties: dict[str, Any]) -> dict[str, Any]:
    return {"type": "Feature", "geometry": geometry, "properties": {"name": name, "kind": kind, **properties}}


def _polygons(rings: Sequence[Array]) -> dict[str, Any]:
    closed = [[[*ring.tolist(), ring[0].tolist()]] for ring in rings]
    if len(closed) == 1:
        return {"type": "Polygon", "coordinates": closed[0]}
    return {"type": "MultiPolygon", "coordinates": closed}


def _footprint(
    view: PinholeView, world_from_camera: Array, points: Array, in_world: Array, placement: Placement
) -> Array:
    """The corners of the image on the ground [N, 3], in the world frame."""
    camera = view.camera
    pixels = camera.project(view.camera_from_model.apply(points))
    shown = ((pixels >= 0.0) & (pixels <= [camera.width, camera.height])).all(axis=1)
    seen = in_world[shown] if shown.any() else in_world
    centre = placement.world_from_model.apply(view.centre)
    ground_m = float(np.median(seen[:, 2]))
    distances_m = np.linalg.norm(seen - centre, axis=1)
    reach_m = _REACH * float(np.percentile(distances_m, _FARTHEST_PERCENTILE))
    corners_px = [(0, 0), (0, camera.height), (camera.width, camera.height), (camera.width, 0)]
    rays = camera.unproject(np.array(corners_px, dtype=np.float64)) @ world_from_camera.T
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    below_m = max(centre[2] - ground_m, 0.0)
    with np.errstate(divide="ignore"):
        lengths_m = np.where(rays[:, 2] < 0.0, below_m / -rays[:, 2], np.inf)
    corners = centre + np.minimum(lengths_m, reach_m)[:, None] * rays
    corners[:, 2] = ground_m
    if abs(placement.position.latitude_deg) < _POLAR_DEG:
        return np.asarray(corners)
    shares = np.arange(_POLAR_PARTS)[:, None] / _POLAR_PARTS
    ends = np.roll(corners, -1, axis=0)
    return np.concatenate([one + shares * (other - one) for one, other in zip(corners, ends, strict=True)])


def split_at_antimeridian(ring: Array) -> list[Array]:
    """The parts of a small polygon of longitudes and latitudes [N, 2], none of which crosses 180°.

    Each is counterclockwise. A polygon around a pole ends at the pole, and at both sides of 180°.
    """
    turns = np.diff(ring[:, 0], append=ring[:1, 0])
    turns -= 360.0 * np.round(turns / 360.0)
    unwrapped = ring.copy()
    unwrapped[1:, 0] = ring[0, 0] + np.cumsum(turns[:-1])
    around = float(turns.sum())
    if abs(around) > 180.0:
        pole = np.copysign(90.0, ring[:, 1].mean())
        end, start = unwrapped[0, 0] + around, unwrapped[0, 0]
        unwrapped = np.vstack([unwrapped, [[end, ring[0, 1]], [end, pole], [start, pole]]])
    first = np.floor((unwrapped[:, 0].min() + 180.0) / 360.0)
    last = np.ceil((unwrapped[:, 0].max() + 180.0) / 360.0)
    parts = []
    for number in np.arange(first, last):
        west = 360.0 * number - 180.0
        part = _beyond(_beyond(unwrapped, west, 1.0), west + 360.0, -1.0)
        if len(part) >= 3:
            part[:, 0] -= 360.0 * number
            parts.append(part if _area(part) > 0.0 else part[::-1])
    return parts


def _beyond(ring: Array, meridian: float, sign: float) -> Array:
    """The part of a polygon on one side of a meridian. Source: Sutherland and Hodgman, 1974."""
    kept: list[Array] = []
    for one, other in zip(ring, np.roll(ring, -1, axis=0), strict=True):
        inside, next_inside = (sign * (point[0] - meridian) >= 0.0 for point in (one, other))
        if inside:
            kept.append(one)
        if inside != next_inside:
            share = (meridian - one[0]) / (other[0] - one[0])
            kept.append(np.array([meridian, one[1] + share * (other[1] - one[1])]))
    return np.array(kept).reshape(-1, 2)


def _area(ring: Array) -> float:
    x, y = ring.T - ring.mean(axis=0)[:, None]
    return float((x * np.roll(y, -1) - np.roll(x, -1) * y).sum())
