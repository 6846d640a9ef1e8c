"""From marks to an alignment by control points: the residual of every point, and what was found."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from fvs_engine.control.alignment import MIN_POINTS, ControlAlignment, SurveyedPoint, align_control_points
from fvs_engine.control.survey import Survey, position_of
from fvs_engine.control.triangulation import MeasuredPoint, Sight, measure
from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.geodetic import GeodeticPosition
from fvs_engine.geometry.rotations import quaternion_from_matrix
from fvs_engine.images.names import listed
from fvs_schema.control_points import (
    ControlPoint,
    ControlPoints,
    ControlResiduals,
    PointResidual,
    PointStatus,
)
from fvs_schema.findings import Finding, FindingCode
from fvs_schema.scenes import Alignment, AlignmentSource, AlignmentStatus, Origin

_UNMEASURED = {
    PointStatus.SEEN_ONCE: FindingCode.CONTROL_POINT_SEEN_ONCE,
    PointStatus.NO_PARALLAX: FindingCode.CONTROL_POINT_WITHOUT_PARALLAX,
    PointStatus.MARKS_DISAGREE: FindingCode.CONTROL_MARKS_DISAGREE,
}


@dataclass(frozen=True, eq=False)
class ControlResult:
    """The ``alignment`` by control points, the ``residuals`` of all points, and warnings."""

    origin: Origin
    alignment: Alignment
    residuals: ControlResiduals
    findings: tuple[Finding, ...]


def align_by_control(
    control: ControlPoints,
    sights: Mapping[str, Sequence[Sight]],
    origin: Origin | None = None,
    near: GeodeticPosition | None = None,
) -> ControlResult:
    """Align a model with surveyed points, of which ``sights`` has the marks in its images, by point.

    ``origin``: of the world frame, by default the middle of the points. ``near``: where the scene is by other
    positions; by default at the origin. Raises ``InvalidInputError`` when the points determine no alignment,
    are far away, or contradict the model or one another.
    """
    survey = Survey.of(control)
    origin = origin or survey.origin
    survey.require_near(near or position_of(origin))
    surveyed = survey.in_world(origin)
    measured = {point.name: measure(sights.get(point.name, ())) for point in control.points}
    known = [
        SurveyedPoint(point.name, at, surveyed[point.name], point.check)
        for point in control.points
        if isinstance(at := measured[point.name], MeasuredPoint)
    ]
    _require_enough(known, measured)
    found = align_control_points(known)
    points = tuple(
        _residual(point, measured[point.name], sights.get(point.name, ()), found) for point in control.points
    )
    checked = [
        point.distance_m
        for point in points
        if point.status is PointStatus.CHECK and point.up_m is not None and point.distance_m is not None
    ]
    residuals = ControlResiduals(
        points=points,
        control_rms_m=found.rms_m,
        check_rms_m=float(np.sqrt(np.mean(np.square(checked)))) if checked else None,
    )
    return ControlResult(origin, _alignment(found, control), residuals, tuple(_findings(points, found)))


def _require_enough(
    known: Sequence[SurveyedPoint], measured: Mapping[str, MeasuredPoint | PointStatus]
) -> None:
    """Raise ``InvalidInputError``, with the reasons, when too few control points are measured."""
    usable = sum(point.usable for point in known)
    if usable >= MIN_POINTS:
        return
    reasons = {
        status: [name for name, found in measured.items() if found is status] for status in _UNMEASURED
    }
    why = "; ".join(f"{status}: {listed(names)}" for status, names in reasons.items() if names)
    raise InvalidInputError(
        f"An alignment needs {MIN_POINTS} control points that are measured and have a height; "
        f"there are {usable}." + (f" Not measured: {why}." if why else ""),
        hint="Mark each point in two photographs or more that look at it from different sides, in px of the "
        "files as they are stored; use fewer as check points.",
    )


def _residual(
    point: ControlPoint, known: MeasuredPoint | PointStatus, sights: Sequence[Sight], found: ControlAlignment
) -> PointResidual:
    if isinstance(known, PointStatus):
        return PointResidual(name=point.name, check=point.check, status=known, marks=len(sights))
    east, north, up = found.residuals[point.name].tolist()
    off = found.residuals[point.name][: 2 if point.z is None else 3]
    return PointResidual(
        name=point.name,
        check=point.check,
        status=_status(point, found),
        east_m=east,
        north_m=north,
        up_m=None if point.z is None else up,
        distance_m=float(np.linalg.norm(off)),
        marks=len(sights),
        wrong_marks=tuple(
            sight.view.name for sight, agrees in zip(sights, known.agrees, strict=True) if not agrees
        ),
        reprojection_px=known.reprojection_px,
    )


def _status(point: ControlPoint, found: ControlAlignment) -> PointStatus:
    if point.check:
        return PointStatus.CHECK
    if point.z is None:
        return PointStatus.NO_HEIGHT
    return PointStatus.USED if point.name in found.used else PointStatus.OUTLIER


def _alignment(found: ControlAlignment, control: ControlPoints) -> Alignment:
    similarity = found.world_from_model
    return Alignment(
        status=AlignmentStatus.ALIGNED,
        source=AlignmentSource.CONTROL_POINTS,
        scale=similarity.scale,
        rotation_wxyz=tuple(quaternion_from_matrix(similarity.rotation).tolist()),
        translation=tuple(similarity.translation.tolist()),
        rms_m=found.rms_m,
        inliers=len(found.used),
        positions=sum(not point.check for point in control.points),
    )


def _findings(points: Sequence[PointResidual], found: ControlAlignment) -> Iterator[Finding]:
    for first, second in found.swapped:
        yield Finding.of(FindingCode.CONTROL_POINTS_SWAPPED, first=first, second=second)
    swapped = {name for pair in found.swapped for name in pair}
    for point in points:
        if point.status in _UNMEASURED:
            yield Finding.of(_UNMEASURED[point.status], point=point.name)
        if point.status is PointStatus.OUTLIER and point.name not in swapped:
            off_m = point.distance_m or 0.0
            yield Finding.of(FindingCode.CONTROL_POINT_OFF, point=point.name, distance_m=off_m)
        if point.wrong_marks:
            yield Finding.of(FindingCode.CONTROL_MARK_OFF, point.wrong_marks, point=point.name)
