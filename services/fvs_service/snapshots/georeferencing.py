"""Georeferencing: the alignment of a model with the position priors of its images, and its ground."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.attitudes import Attitude
from fvs_engine.geometry.alignment.positions import GPS_ACCURACY_M
from fvs_engine.geometry.alignment.world import georeference
from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic, geodetic_coordinates
from fvs_engine.geometry.ground_of_points import ground_of_points
from fvs_schema.images import Image, Prior
from fvs_schema.scenes import Alignment, Origin, Scene
from fvs_schema.snapshots import SnapshotAlignment
from fvs_schema.terrain import Terrain
from fvs_service.scenes.poses import WorldFrame, geodetic_origin

Array = NDArray[np.float64]

_SAME_TAKEOFF_M = 3.0
"""Barometers drift by less during a flight."""


def align(
    scene: Scene,
    images: Mapping[str, Image],
    model_from_camera: Mapping[str, RigidTransform],
    *,
    positions_ignored: bool = False,
) -> Alignment:
    """Align the registered cameras (digest → model_from_camera) with the priors of their images.

    With too few or degenerate positions, or ones that contradict the model or were ignored when it was made,
    the world frame stays the model frame.
    """
    known = [
        (camera, position, _attitude(image.prior), position_sigma_m(image.prior))
        for digest, camera in model_from_camera.items()
        if (image := images.get(digest)) is not None
        and image.prior is not None
        and (position := world_position(image.prior, scene.origin)) is not None
    ]
    if not known:
        return Alignment()
    if positions_ignored:
        return Alignment(positions=len(known))
    found = georeference(
        [camera for camera, *_ in known],
        np.stack([position for _, position, *_ in known]),
        [attitude for _, _, attitude, _ in known],
        np.array([sigma for _, _, _, sigma in known]),
    )
    return Alignment(positions=len(known)) if found is None else found.alignment(len(known))


def takeoff_altitude(
    images: Mapping[str, Image], model_from_camera: Mapping[str, RigidTransform], placed: SnapshotAlignment
) -> float | None:
    """Where the flight of the newest photographs took off, above the datum of the scene's altitudes.

    It is the median of the registered cameras' altitudes less their heights above takeoff, over the
    photographs that agree with the newest. None where that is not on Earth, or no photograph has a height.
    """
    frame = WorldFrame(placed.origin, placed)
    known = [
        (image.captured_at or image.received_at, camera.translation, height_m)
        for digest, camera in model_from_camera.items()
        if (image := images.get(digest)) is not None
        and image.prior is not None
        and (height_m := image.prior.height_above_takeoff_m) is not None
    ]
    if not frame.georeferenced or not known:
        return None
    taken_at, centres, heights_m = zip(*known, strict=True)
    origin = geodetic_origin(frame.require_origin())
    altitudes_m = geodetic_coordinates(frame.world_from_model.apply(np.stack(centres)), origin)[:, 2]
    takeoffs_m = altitudes_m - np.array(heights_m)
    newest_m = takeoffs_m[taken_at.index(max(taken_at))]
    return float(np.median(takeoffs_m[np.abs(takeoffs_m - newest_m) <= _SAME_TAKEOFF_M]))


def ground_of(points: Array, placed: SnapshotAlignment) -> Terrain | None:
    """The ground by points [N, 3] of the model frame; None where that is not on Earth, or of too few."""
    frame = WorldFrame(placed.origin, placed)
    if not frame.georeferenced:
        return None
    origin = frame.require_origin()
    geodetic = geodetic_coordinates(frame.world_from_model.apply(points), geodetic_origin(origin))
    try:
        return ground_of_points(geodetic, origin.altitude_datum)
    except InvalidInputError:
        return None


def world_position(prior: Prior, origin: Origin | None) -> np.ndarray | None:
    """The position [3] of a prior in the world frame; None without one, or without a matching datum."""
    if prior.x_m is not None and prior.y_m is not None and prior.z_m is not None:
        return np.array([prior.x_m, prior.y_m, prior.z_m])
    if (
        prior.latitude_deg is None
        or prior.longitude_deg is None
        or prior.altitude_m is None
        or origin is None
        or prior.altitude_datum is not origin.altitude_datum
    ):
        return None
    position = GeodeticPosition(prior.latitude_deg, prior.longitude_deg, prior.altitude_m)
    return enu_from_geodetic(position, geodetic_origin(origin))


def position_sigma_m(prior: Prior) -> float:
    """The standard deviation of a prior's position; by default that of GPS, where it is from GPS."""
    if prior.position_sigma_m is not None:
        return prior.position_sigma_m
    return GPS_ACCURACY_M if prior.geodetic else 0.0


def _attitude(prior: Prior | None) -> Attitude | None:
    return None if prior is None else Attitude(prior.yaw_deg, prior.pitch_deg, prior.roll_deg)
