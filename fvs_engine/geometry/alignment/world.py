"""Georeferencing: alignment of a reconstruction with position priors of its images."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.similarity import robust_umeyama
from fvs_engine.geometry.transforms import RigidTransform, SimilarityTransform

Array = NDArray[np.float64]

_MIN_ATTITUDES = 2
_MAX_ATTITUDE_SPREAD_DEG = 10.0
"""Scatter of the attitudes' turns about the track above which they contradict each other."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """``world_from_model``, and the residuals over the ``inliers`` positions in world units.

    ``ill_conditioned``: the camera centres lie on a line, and no attitudes fixed the rotation about it.
    """

    world_from_model: SimilarityTransform
    rms: float
    inliers: int
    ill_conditioned: bool


def georeference(
    model_from_cameras: Sequence[RigidTransform],
    world_positions: Array,
    world_from_camera_rotations: Sequence[Array | None] | None = None,
    *,
    seed: int = 0,
) -> Georeference | None:
    """Align camera centres with position priors [N, 3]; None if the priors do not determine it.

    Robust: up to half of the positions may be wrong. Where the centres lie on a line the rotation about it is
    taken from the attitudes (rotations [3, 3] or None per camera), when at least two agree.
    """
    if len(model_from_cameras) < 3:
        return None
    centres = np.stack([camera.translation for camera in model_from_cameras])
    try:
        report = robust_umeyama(centres, world_positions, seed=seed)
    except InvalidInputError:
        return None
    transform, ill_conditioned = report.transform, report.ill_conditioned
    if ill_conditioned and world_from_camera_rotations is not None:
        turn = _turn_about_track(
            transform, model_from_cameras, world_positions[report.inliers], world_from_camera_rotations
        )
        if turn is not None:
            transform, ill_conditioned = turn @ transform, False
    return Georeference(transform, report.rms, int(report.inliers.sum()), ill_conditioned)


def _turn_about_track(
    world_from_model: SimilarityTransform,
    model_from_cameras: Sequence[RigidTransform],
    track: Array,
    world_from_camera_rotations: Sequence[Array | None],
) -> SimilarityTransform | None:
    """The turn about the line through ``track`` that brings cameras nearest to their attitudes."""
    middle = track.mean(axis=0)
    axis = np.linalg.svd(track - middle)[2][0]
    angles = []
    for camera, attitude in zip(model_from_cameras, world_from_camera_rotations, strict=True):
        if attitude is None:
            continue
        off = Rotation.from_matrix(attitude @ (world_from_model.rotation @ camera.rotation).T)
        x, y, z, w = off.as_quat()
        angles.append(2.0 * math.atan2(float(np.dot([x, y, z], axis)), float(w)))  # swing-twist
    if len(angles) < _MIN_ATTITUDES:
        return None
    mean = complex(np.mean(np.exp(1j * np.array(angles))))
    # For a wrapped normal distribution |mean| = exp(−σ²/2).
    spread_deg = math.degrees(math.sqrt(-2.0 * math.log(max(abs(mean), 1e-12))))
    if spread_deg > _MAX_ATTITUDE_SPREAD_DEG:
        return None
    rotation = Rotation.from_rotvec(float(np.angle(mean)) * axis).as_matrix()
    return SimilarityTransform(1.0, rotation, middle - rotation @ middle)
