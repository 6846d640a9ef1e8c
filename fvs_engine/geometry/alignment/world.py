"""Georeferencing: alignment of a reconstruction with position priors of its images."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.attitudes import Attitude, Headings, model_down
from fvs_engine.geometry.alignment.positions import fit_positions
from fvs_engine.geometry.alignment.similarity import robust_umeyama
from fvs_engine.geometry.rotations import matrix_from_rotation_vector, quaternion_from_matrix
from fvs_engine.geometry.transforms import RigidTransform, SimilarityTransform
from fvs_schema.scenes import Alignment, AlignmentStatus

Array = NDArray[np.float64]

_GRAVITY_RAD = np.deg2rad(1.0)
_YAW_RAD = np.deg2rad(5.0)
"""Standard errors of gravity and of yaw, which the cameras of one flight share: more cameras do not help."""
_MAX_GRAVITY_ERROR_RAD = np.deg2rad(8.0)
"""Largest angle to gravity after the fit; beyond it the attitudes contradict the positions."""
_MAX_YAW_ERROR_RAD = np.deg2rad(15.0)
"""Largest heading error of an undisturbed compass."""
_MAX_MISFIT = 2.0
"""Ratio of the RMS with attitudes to that without, above which the attitudes contradict the positions."""
_MIN_NOISE_M = 0.02
"""Minimum standard error of positions: that of a receiver with corrections."""
_MAX_UNCERTAINTY_RAD = np.deg2rad(5.0)
_MOST_ATTITUDES = 300
"""Maximum number of attitudes in a fit: more add no information."""
_STARTS = 6
"""Number of rotations about the track from which a fit is started."""
_MAX_OFF = 4.0
"""A camera farther than this from its position, in standard errors of one coordinate, is an outlier."""


@dataclass(frozen=True, eq=False)
class Georeference:
    """``world_from_model``, and the residuals over the ``inliers`` positions in world units.

    ``ill_conditioned``: the camera centres lie on a line, and no attitudes fixed the rotation about it.
    """

    world_from_model: SimilarityTransform
    rms: float
    inliers: int
    ill_conditioned: bool

    def alignment(self, positions: int) -> Alignment:
        """The record of it, found with so many ``positions``."""
        similarity = self.world_from_model
        return Alignment(
            status=AlignmentStatus.ILL_CONDITIONED if self.ill_conditioned else AlignmentStatus.ALIGNED,
            scale=similarity.scale,
            rotation_wxyz=tuple(quaternion_from_matrix(similarity.rotation).tolist()),
            translation=tuple(similarity.translation.tolist()),
            rms_m=self.rms,
            inliers=self.inliers,
            positions=positions,
        )


def georeference(
    model_from_cameras: Sequence[RigidTransform],
    world_positions: Array,
    attitudes: Sequence[Attitude | None] | None = None,
    position_sigmas: Array | None = None,
) -> Georeference | None:
    """Align camera centres with position priors [N, 3], z up; None if the priors do not determine it.

    Robust: up to a third of the positions may be wrong. When more are, for their ``position_sigmas`` [N]
    (by default 0), they contradict the model, and there is no alignment. Where the centres lie on a line they
    leave the rotation about it open, and by their noise its tilt; then positions and attitudes (one or None
    per camera) are fitted together. Attitudes that contradict each other or the positions are not used; nor
    are yaws alone that contradict gravity and positions.
    """
    if len(model_from_cameras) < 3:
        return None
    centres = np.stack([camera.translation for camera in model_from_cameras])
    try:
        report = robust_umeyama(centres, world_positions)
    except InvalidInputError:
        return None
    sigmas = np.zeros(len(centres)) if position_sigmas is None else position_sigmas
    fit = fit_positions(centres, world_positions, sigmas)
    if fit is not None and fit.contradicts:
        return None
    inliers = report.inliers
    found = Georeference(report.transform, report.rms, int(inliers.sum()), report.ill_conditioned)
    if not report.ill_conditioned or attitudes is None:
        return found
    every = max(1, len(attitudes) // _MOST_ATTITUDES)
    cameras, known = model_from_cameras[::every], attitudes[::every]
    reports = _Reports(model_down(cameras, known), Headings.of(cameras, known))
    count = int(inliers.sum())
    noise = report.rms / np.sqrt(3.0) * np.sqrt(3 * count / max(3 * count - 7, 1))
    track = _Track(centres[inliers], world_positions[inliers], max(float(noise), _MIN_NOISE_M))
    rotation = _with_attitudes(track, track.turns(report.transform.rotation), reports)
    if rotation is None:
        return found
    # Without attitudes the free rotation overfits half of the positions, and good ones look like outliers.
    off = track.placed(rotation).apply(centres) - world_positions
    noise = max(1.4826 * float(np.median(np.abs(off))), _MIN_NOISE_M)
    near = np.linalg.norm(off, axis=1) <= _MAX_OFF * noise
    track = _Track(centres[near], world_positions[near], noise)
    refined = _with_attitudes(track, [rotation], reports)
    if refined is None:
        return found
    transform = track.placed(refined)
    return Georeference(transform, track.rms(transform), int(near.sum()), False)


@dataclass(frozen=True, eq=False)
class _Track:
    """Camera centres in the model, their positions in the world [N, 3], and the positions' noise."""

    centres: Array
    positions: Array
    noise: float

    def placed(self, rotation: Array) -> SimilarityTransform:
        """The best similarity with this rotation; its scale is never negative."""
        middle, target = self.centres.mean(axis=0), self.positions.mean(axis=0)
        turned = (self.centres - middle) @ rotation.T
        lever = float((turned * (self.positions - target)).sum())
        scale = max(lever, 1e-12) / float((turned**2).sum())
        return SimilarityTransform(scale, rotation, target - scale * rotation @ middle)

    def misses(self, world_from_model: SimilarityTransform) -> Array:
        """Differences of the aligned centres from the positions [N, 3]."""
        return np.asarray(world_from_model.apply(self.centres) - self.positions)

    def rms(self, world_from_model: SimilarityTransform) -> float:
        """The RMS distance of the aligned centres from the positions."""
        return float(np.sqrt((self.misses(world_from_model) ** 2).sum(axis=1).mean()))

    def turns(self, rotation: Array) -> list[Array]:
        """The rotation, also turned about the track, which the positions leave open."""
        axis = np.linalg.svd(self.positions - self.positions.mean(axis=0))[2][0]
        angles = np.arange(_STARTS) * (2.0 * np.pi / _STARTS)
        return [matrix_from_rotation_vector(angle * axis) @ rotation for angle in angles]


@dataclass(frozen=True, eq=False)
class _Reports:
    """The direction of gravity in the model and the headings, as the cameras' attitudes determine them."""

    down: Array | None
    headings: Headings


def _with_attitudes(track: _Track, starts: Sequence[Array], reports: _Reports) -> Array | None:
    """The rotation that positions and attitudes determine; None when they leave it open or disagree."""
    down, headings = reports.down, reports.headings
    rotation, uncertainty = (starts[0], np.inf) if down is None else _fit(track, starts, down, None)
    error = headings.error_rad(rotation)
    disturbed = error is None or abs(error) > _MAX_YAW_ERROR_RAD
    if uncertainty > _MAX_UNCERTAINTY_RAD or not disturbed:
        rotation, uncertainty = _fit(track, starts, down, headings)
    limit = _MAX_MISFIT * max(track.rms(track.placed(starts[0])), np.sqrt(3.0) * track.noise)
    tilted = down is not None and np.arccos(np.clip(-(rotation @ down)[2], -1, 1)) > _MAX_GRAVITY_ERROR_RAD
    if uncertainty > _MAX_UNCERTAINTY_RAD or tilted or track.rms(track.placed(rotation)) > limit:
        return None
    return rotation


def _fit(
    track: _Track, starts: Sequence[Array], down: Array | None, headings: Headings | None
) -> tuple[Array, float]:
    """The most likely rotation, and its standard error about the least certain axis."""
    from scipy.optimize import least_squares  # slow to import

    def residuals(turn: Array, base: Array) -> Array:
        rotation = matrix_from_rotation_vector(turn) @ base
        parts = [(track.misses(track.placed(rotation)) / track.noise).ravel()]
        if down is not None:
            parts.append((rotation @ down + np.array([0.0, 0.0, 1.0])) / _GRAVITY_RAD)
        if headings is not None:
            parts.append(np.array([(headings.error_rad(rotation) or 0.0) / _YAW_RAD]))
        return np.concatenate(parts)

    fits = [(least_squares(residuals, np.zeros(3), args=(start,)), start) for start in starts]
    best, start = min(fits, key=lambda found: found[0].cost)
    rotation = matrix_from_rotation_vector(best.x) @ start
    information = np.linalg.eigvalsh(best.jac.T @ best.jac)[0]
    return rotation, float(1.0 / np.sqrt(information)) if information > 0 else np.inf
