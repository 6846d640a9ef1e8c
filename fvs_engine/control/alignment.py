"""The similarity from a model to the world by control points, and the residual of every point."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.control.triangulation import MeasuredPoint
from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import AlignmentReport, robust_umeyama
from fvs_engine.geometry.transforms import SimilarityTransform

Array = NDArray[np.float64]

MIN_POINTS = 3
"""Points that a similarity needs."""
_MIN_AGREEING = 4
"""Points that must agree where one is left out: any three nearly agree, mirrored ones too."""
_NOISE = 3.0
"""Errors of a right point, in standard errors of its measurement by marks that are 1 px off."""
_MAX_MISFIT = 0.05
"""RMS distance of the used points, in shares of their spread, above which they contradict the model."""
_SWAPPED = 0.1
"""How far each of two swapped points is from where the other was surveyed, in shares of their distance."""
_MOST_SWAPS = 50
"""Number of points up to which every swap of two is tried."""


@dataclass(frozen=True, eq=False)
class SurveyedPoint:
    """A measured point and its ``surveyed`` position [3] in the world frame; its height may be NaN.

    ``check``: it is not used for the alignment.
    """

    name: str
    measured: MeasuredPoint
    surveyed: Array
    check: bool

    @property
    def usable(self) -> bool:
        """Whether it can determine the alignment."""
        return not self.check and bool(np.isfinite(self.surveyed).all())


@dataclass(frozen=True, eq=False)
class ControlAlignment:
    """``world_from_model``, ``rms_m`` of the ``used`` points, and the points that were swapped, in pairs.

    ``residuals``: name → model minus survey [3] of every point; the height may be NaN.
    """

    world_from_model: SimilarityTransform
    rms_m: float
    used: frozenset[str]
    residuals: Mapping[str, Array]
    swapped: tuple[tuple[str, str], ...]


def align_control_points(points: Sequence[SurveyedPoint]) -> ControlAlignment:
    """Align the model with the points that are for it, and measure all of them.

    At least three are ``usable``. Robust: points that contradict the others are not used. Raises
    ``InvalidInputError`` for points on a line, and points that contradict the model or one another.
    """
    usable = [point for point in points if point.usable]
    model = np.stack([point.measured.position for point in usable])
    world = np.stack([point.surveyed for point in usable])
    try:
        report = _fit(usable, model, world)
    except InvalidInputError as error:
        raise InvalidInputError(
            f"The control points do not determine an alignment: {error.message}", hint=error.hint
        ) from error
    inliers = report.inliers
    if _contradicts(report, world):
        raise InvalidInputError(
            f"The control points contradict the model or one another: {int(inliers.sum())} of {len(usable)} "
            f"agree on an alignment, and miss it by {report.rms:.3g} m (RMS).",
            hint=_remedy(usable, model, world),
        )
    if report.ill_conditioned:
        raise InvalidInputError(
            "The control points lie on a line, and leave the rotation about it open.",
            hint="Mark a point away from that line as well.",
        )
    residuals = {
        point.name: report.transform.apply(point.measured.position) - point.surveyed for point in points
    }
    used = frozenset(point.name for point, fits in zip(usable, inliers, strict=True) if fits)
    return ControlAlignment(
        report.transform, report.rms, used, residuals, _swapped(points, used, residuals, report)
    )


def _fit(points: Sequence[SurveyedPoint], model: Array, world: Array) -> AlignmentReport:
    """The robust fit; all points count that are off by no more than their marks explain."""
    report = robust_umeyama(model, world)
    sigma_m = report.scale * float(np.median([point.measured.sigma for point in points]))
    off = np.linalg.norm(report.transform.apply(model) - world, axis=1)
    limit_m = max(_NOISE * sigma_m, float(off[report.inliers].max()))
    if limit_m > 0 and (off[~report.inliers] <= limit_m).any():
        return robust_umeyama(model, world, inlier_threshold=limit_m)
    return report


def _contradicts(report: AlignmentReport, world: Array) -> bool:
    agreeing = int(report.inliers.sum())
    few = agreeing < len(world) and (agreeing < _MIN_AGREEING or 2 * agreeing <= len(world))
    return few or report.rms > _MAX_MISFIT * centre_spread(world[report.inliers])


def _remedy(points: Sequence[SurveyedPoint], model: Array, world: Array) -> str:
    """What to check; names two points if all is well once they are swapped."""
    best, names = np.inf, ("", "")
    pairs = itertools.combinations(range(len(points)), 2) if len(points) <= _MOST_SWAPS else ()
    for i, j in pairs:
        order = np.arange(len(points))
        order[[i, j]] = order[[j, i]]
        try:
            report = robust_umeyama(model, world[order])
        except InvalidInputError:  # no three agree
            continue
        off = np.linalg.norm(report.transform.apply(model) - world[order], axis=1)
        if not _contradicts(report, world[order]) and off.max() < best:
            best, names = float(off.max()), (points[i].name, points[j].name)
    if best < _MAX_MISFIT * centre_spread(world):
        return f"{names[0]} and {names[1]} may be swapped: then all points fit within {best:.2g} m."
    return "Check the CRS, the order of the coordinates (x is east), and the names of the points."


def _swapped(
    points: Sequence[SurveyedPoint],
    used: frozenset[str],
    residuals: Mapping[str, Array],
    report: AlignmentReport,
) -> tuple[tuple[str, str], ...]:
    """Pairs of points off, of which each is where the other should be."""
    most_m = max(_length(residuals[name]) for name in used)
    off = [
        point for point in points if point.name not in used and _length(residuals[point.name]) > 2.0 * most_m
    ]
    found = []
    for one, other in itertools.combinations(off, 2):
        apart_m = _length(one.surveyed - other.surveyed)
        crossed = (
            report.transform.apply(one.measured.position) - other.surveyed,
            report.transform.apply(other.measured.position) - one.surveyed,
        )
        if max(map(_length, crossed)) <= _SWAPPED * apart_m:
            found.append((one.name, other.name))
    return tuple(found)


def _length(difference: Array) -> float:
    """The length of a difference [3], without its height where that is NaN."""
    return float(np.linalg.norm(np.nan_to_num(difference)))
