"""The similarity that takes one set of points onto another: Kabsch–Umeyama, plain and robust.

Source: Umeyama, "Least-squares estimation of transformation parameters between two point patterns", 1991.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.transforms import SimilarityTransform

Array = NDArray[np.float64]

_COINCIDENT = 1e-9
"""Ratio of spread to magnitude below which points count as one point."""

_MIN_WIDTH_RATIO = 0.01
"""Ratio of width to length below which a track counts as a line."""

_MAX_ROLL_DEG = 5.0
"""Uncertainty of the rotation about the track's own axis above which an alignment is ill-conditioned."""

_SAMPLES = 1000
"""Number of random triples of points that are tried."""

_BLOCK_RESIDUALS = 1 << 18
"""Residuals computed at once while triples are compared: bounds the memory."""


@dataclass(frozen=True, eq=False)
class AlignmentReport:
    """A similarity from source to target points, and its residuals.

    ``transform`` is target_from_source. ``rms`` and ``median`` are residuals of the inliers in the target's
    unit; ``inliers`` is bool [N]. ``collinearity`` is 1 for points on a line and 0 for points spread evenly
    about their main plane. ``roll_uncertainty_deg`` is the standard error of the rotation about the line
    that fits the points best: the rotation that a straight track leaves open. ``ill_conditioned``:
    this rotation is not reliable.
    """

    transform: SimilarityTransform
    rms: float
    median: float
    inliers: NDArray[np.bool_]
    collinearity: float
    roll_uncertainty_deg: float

    @property
    def scale(self) -> float:
        """Target units per source unit."""
        return self.transform.scale

    @property
    def ill_conditioned(self) -> bool:
        """Whether the points are so close to a line that the rotation about it is open."""
        return self.collinearity > 1.0 - _MIN_WIDTH_RATIO or self.roll_uncertainty_deg > _MAX_ROLL_DEG


def umeyama(source: ArrayLike, target: ArrayLike, with_scale: bool = True) -> SimilarityTransform:
    """The target_from_source similarity with the least squared residuals over matching points [N, 3].

    ``with_scale=False`` keeps the scale at 1 (Kabsch). Points on a line leave the rotation about it open;
    an arbitrary one is then returned; ``alignment_report`` detects that.

    Raises ``InvalidInputError`` for fewer than 3 points, numbers that are not finite, shapes that do not
    match, and points that all coincide.
    """
    source_points, target_points = _check_pair(source, target)
    scale, rotation, translation = _fit(source_points[None], target_points[None], with_scale)
    return SimilarityTransform(float(scale[0]), rotation[0], translation[0])


def alignment_report(
    source: ArrayLike,
    target: ArrayLike,
    transform: SimilarityTransform,
    inliers: NDArray[np.bool_] | None = None,
) -> AlignmentReport:
    """Residuals and conditioning of ``transform`` (target_from_source); ``inliers`` [N]: default all."""
    source_points, target_points = _check_pair(source, target)
    mask = np.ones(len(source_points), dtype=bool) if inliers is None else inliers
    residuals = np.linalg.norm(transform.apply(source_points) - target_points, axis=1)[mask]
    rms = float(np.sqrt(np.mean(residuals**2)))
    length, width = _length_and_width(target_points[mask])
    count = int(mask.sum())
    # Distances from the line are the lever arms by which residuals rotate the model about it.
    roll_rad = math.atan2(rms, width * math.sqrt(count)) if rms > 0 or width > 0 else math.pi / 2
    return AlignmentReport(
        transform=transform,
        rms=rms,
        median=float(np.median(residuals)),
        inliers=mask,
        collinearity=1.0 - width / length,
        roll_uncertainty_deg=math.degrees(roll_rad),
    )


def robust_umeyama(
    source: ArrayLike,
    target: ArrayLike,
    *,
    inlier_threshold: float | None = None,
    seed: int = 0,
) -> AlignmentReport:
    """Umeyama on the points that agree, found by RANSAC over triples; deterministic for a ``seed``.

    ``inlier_threshold`` is in the target's unit. Without one the best triple is that with the least median
    residual (so up to half of the points may be wrong) and inliers lie within 2.5 robust standard
    deviations of it (Rousseeuw & Leroy, "Robust Regression and Outlier Detection", 1987). Small sets are
    searched exhaustively. Raises ``InvalidInputError`` as ``umeyama`` does, and when no three agree.
    """
    source_points, target_points = _check_pair(source, target)
    if inlier_threshold is not None and not inlier_threshold > 0:
        raise InvalidInputError(f"inlier_threshold must be positive, not {inlier_threshold}.")
    triples = _triples(len(source_points), seed)
    triples = triples[_spans_a_plane(source_points[triples]) & _spans_a_plane(target_points[triples])]
    if len(triples) == 0:  # every sampled triple is on a line: the plain fit is all there is
        transform = umeyama(source_points, target_points)
        return alignment_report(source_points, target_points, transform)

    transform, threshold = _best_of(triples, source_points, target_points, inlier_threshold)
    inliers = _residuals(transform, source_points, target_points) <= threshold
    for _ in range(20):  # refit on all that agree; settles in two or three rounds
        if inliers.sum() < 3 or _coincide(source_points[inliers]) or _coincide(target_points[inliers]):
            raise InvalidInputError(
                "No three points agree on one alignment.", hint="Check that the points are matched."
            )
        transform = umeyama(source_points[inliers], target_points[inliers])
        agreeing = _residuals(transform, source_points, target_points) <= threshold
        if (agreeing == inliers).all() or agreeing.sum() < 3:
            break
        inliers = agreeing
    return alignment_report(source_points, target_points, transform, inliers)


def _check_pair(source: ArrayLike, target: ArrayLike) -> tuple[Array, Array]:
    source_points = np.asarray(source, dtype=np.float64)
    target_points = np.asarray(target, dtype=np.float64)
    if source_points.shape != target_points.shape or source_points.ndim != 2 or source_points.shape[1] != 3:
        raise InvalidInputError(
            f"Source and target must be matching points [N, 3], not {list(source_points.shape)} "
            f"and {list(target_points.shape)}."
        )
    if len(source_points) < 3:
        raise InvalidInputError(f"An alignment needs at least 3 points, not {len(source_points)}.")
    for name, points in (("source", source_points), ("target", target_points)):
        if not np.isfinite(points).all():
            raise InvalidInputError(f"A {name} point is not finite.")
        if _coincide(points):
            raise InvalidInputError(f"All {name} points coincide: they fix neither scale nor rotation.")
    return source_points, target_points


def _coincide(points: Array) -> bool:
    spread = np.abs(points - points.mean(axis=0)).max()
    return bool(spread <= _COINCIDENT * np.abs(points).max())


def _fit(source: Array, target: Array, with_scale: bool) -> tuple[Array, Array, Array]:
    """Fit K problems at once: points [K, N, 3] → scale [K], rotation [K, 3, 3], translation [K, 3]."""
    source_mean, target_mean = source.mean(axis=1), target.mean(axis=1)
    source_centred, target_centred = source - source_mean[:, None], target - target_mean[:, None]
    covariance = np.einsum("kni,knj->kij", target_centred, source_centred)
    U, singular, Vt = np.linalg.svd(covariance)
    signs = np.ones_like(singular)
    signs[:, 2] = np.where(np.linalg.det(U) * np.linalg.det(Vt) < 0, -1.0, 1.0)  # no reflections
    rotation = (U * signs[:, None, :]) @ Vt
    if with_scale:
        scale = (singular * signs).sum(axis=1) / (source_centred**2).sum(axis=(1, 2))
    else:
        scale = np.ones(len(source))
    translation = target_mean - scale[:, None] * np.einsum("kij,kj->ki", rotation, source_mean)
    return scale, rotation, translation


def _residuals(transform: SimilarityTransform, source: Array, target: Array) -> Array:
    return np.asarray(np.linalg.norm(transform.apply(source) - target, axis=-1))


def _triples(count: int, seed: int) -> NDArray[np.int64]:
    """All triples when there are few, else ``_SAMPLES`` random ones, as indices [K, 3]."""
    if math.comb(count, 3) <= _SAMPLES:
        return np.array(list(itertools.combinations(range(count), 3)))
    generator = np.random.default_rng(seed)
    return np.array([generator.choice(count, size=3, replace=False) for _ in range(_SAMPLES)])


def _spans_a_plane(triangles: Array) -> NDArray[np.bool_]:
    """Whether the corners [K, 3, 3] are far enough from a line to fix a rotation."""
    first, second = triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0]
    area = np.linalg.norm(np.cross(first, second), axis=1)
    sides = np.linalg.norm(np.stack([first, second, second - first]), axis=-1)
    return np.asarray(area > 1e-6 * np.maximum(sides.max(axis=0) ** 2, 1e-300))


def _best_of(
    triples: NDArray[np.int64], source: Array, target: Array, threshold: float | None
) -> tuple[SimilarityTransform, float]:
    """The triple's fit that most points agree with, and the threshold that makes an inlier."""
    scale, rotation, translation = _fit(source[triples], target[triples], with_scale=True)
    costs = np.empty(len(triples))
    block = max(1, _BLOCK_RESIDUALS // len(source))
    for start in range(0, len(triples), block):
        k = slice(start, start + block)
        landed = scale[k, None, None] * (source @ rotation[k].swapaxes(1, 2)) + translation[k, None]
        residuals = np.linalg.norm(landed - target, axis=2)
        if threshold is None:
            costs[k] = np.median(residuals, axis=1)
        else:  # MSAC: outliers cost the threshold, inliers what they miss by
            costs[k] = np.minimum(residuals, threshold).sum(axis=1)
    costs[scale <= 0] = np.inf
    best = int(np.argmin(costs))
    transform = SimilarityTransform(float(scale[best]), rotation[best], translation[best])
    if threshold is None:
        deviation = 1.4826 * (1.0 + 5.0 / max(len(source) - 3, 1)) * float(costs[best])
        rounding = 1e-9 * float(np.abs(target).max())  # exact data must not lose points to rounding
        threshold = max(2.5 * deviation, rounding)
    return transform, threshold


def _length_and_width(points: Array) -> tuple[float, float]:
    """RMS extent of points [N, 3] along and across the line that fits them best."""
    singular = np.linalg.svd(points - points.mean(axis=0), compute_uv=False) / math.sqrt(len(points))
    return float(singular[0]), float(singular[1])
