"""Where on Earth the model of an output folder is, by the positions in its photographs."""

from pathlib import Path

import numpy as np

from fvs_engine.errors import InvalidInputError
from fvs_engine.export.placement import Placement
from fvs_engine.geometry.alignment.attitudes import Attitude
from fvs_engine.geometry.alignment.positions import GPS_ACCURACY_M
from fvs_engine.geometry.alignment.world import georeference
from fvs_engine.geometry.geodetic import GeodeticPosition, enu_from_geodetic, middle_position
from fvs_engine.images.metadata import PhotographPriors
from fvs_engine.pipeline.control import read_control
from fvs_engine.pipeline.model import FolderModel
from fvs_schema.scenes import Alignment, AlignmentStatus, AltitudeDatum, Origin

_MODEL_FRAME = (
    "Export it in the model frame, reconstruct photographs that have GPS positions, or give control points "
    "with `fvs align`."
)


def place(model: FolderModel) -> Placement:
    """Where control points put the model, or else the GPS positions of its photographs, from their middle.

    Altitudes of GPS are above sea level, as EXIF has them. Raises ``InvalidInputError`` when there are too
    few positions, or they contradict the model.
    """
    root = model.workspace.root
    control = read_control(model.workspace)
    if control is not None:
        return Placement(control.origin, control.alignment)
    if not model.manifest.settings.gps:
        raise InvalidInputError(
            f"{root} was reconstructed without the positions of its photographs.",
            hint=_MODEL_FRAME,
            path=root,
        )
    known = [
        (
            view.camera_from_model.inverse(),
            position,
            Attitude(priors.yaw_deg, priors.pitch_deg, priors.roll_deg),
        )
        for view in model.registered
        if (position := _position(priors := model.workspace.read_priors(view.name))) is not None
    ]
    found = None
    if known:
        middle = middle_position([position for _, position, _ in known])
        found = georeference(
            [camera for camera, _, _ in known],
            np.stack([enu_from_geodetic(position, middle) for _, position, _ in known]),
            [attitude for _, _, attitude in known],
            np.full(len(known), GPS_ACCURACY_M),
        )
    if found is None:
        raise InvalidInputError(
            f"{root} has no place on Earth: of its {len(model.registered)} photographs "
            f"{len(known)} have a position with an altitude"
            + (", and these determine none or contradict the model." if len(known) >= 3 else "."),
            hint=_MODEL_FRAME,
            path=root,
        )
    origin = Origin(
        latitude_deg=middle.latitude_deg,
        longitude_deg=middle.longitude_deg,
        altitude_m=middle.altitude_m,
        altitude_datum=AltitudeDatum.SEA_LEVEL,
    )
    return Placement(origin, found.alignment(len(known)))


def require_place(origin: Origin | None, alignment: Alignment, root: Path) -> Placement:
    """The place of the snapshot in ``root``; raises ``InvalidInputError`` when it has none."""
    if origin is None or alignment.status is AlignmentStatus.MODEL:
        raise InvalidInputError(
            f"{root} has no place on Earth: its scene has no origin, or its images do not determine one.",
            hint=_MODEL_FRAME,
            path=root,
        )
    return Placement(origin, alignment)


def _position(priors: PhotographPriors) -> GeodeticPosition | None:
    latitude, longitude, altitude = priors.latitude_deg, priors.longitude_deg, priors.altitude_m
    if latitude is None or longitude is None or altitude is None:
        return None
    return GeodeticPosition(latitude, longitude, altitude)
