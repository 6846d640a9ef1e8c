"""Where the dataset's frame lies in the model: ``model_from_world``, from all views that are in both.

Source: the paper, section III (Kabsch–Umeyama over the visited views' positions). It takes the first ten
views; here all visited ones speak, so that the alignment follows a model that grows beyond them, and single
views that were registered wrongly are outvoted.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import (
    AlignmentReport,
    RigidTransform,
    SimilarityTransform,
    angle_between,
    robust_umeyama,
)
from fvs_engine.select.loop_records import AlignmentRecord

Array = NDArray[np.float64]

_MAX_MISFIT = 0.25
"""RMS distance of aligned centres in shares of their spread: more than a bare GPS track may have."""

_MAX_ATTITUDE_DEG = 20.0
"""Median angle between aligned attitudes: more than a gimbal's angles are off, less than any wrong axis."""

_MANY = 10
"""Views from which on their residuals say what an outlier is."""

_MIN_INLIERS = 0.5
"""Share of the views that must agree."""

_HINT = (
    "Check that the poses belong to these photographs and which axes they use; `--poses known` takes them as "
    "they are."
)


@dataclass(frozen=True, eq=False)
class ModelAlignment:
    """``model_from_world``, and what is written down about it."""

    model_from_world: SimilarityTransform
    record: AlignmentRecord


def same_frame(views: int) -> ModelAlignment:
    """The alignment of a model that lives in the dataset's frame."""
    record = AlignmentRecord(source="known", scale=1.0, rms=0.0, attitude_deg=0.0, views=views, inliers=views)
    return ModelAlignment(SimilarityTransform.identity(), record)


def align_to_model(
    world_from_cameras: Sequence[RigidTransform], model_from_cameras: Sequence[RigidTransform]
) -> ModelAlignment:
    """Align the dataset's frame with the model's by matching cameras of at least two views.

    Centres fix the similarity, robustly. Where they leave the rotation open (two views; a straight track) the
    mean of what the attitudes say takes its place, and centres fix the rest.

    Raises ``InvalidInputError`` for fewer than two views, centres that coincide, and poses that contradict
    the model: centres or attitudes that lie far apart after the best alignment.
    """
    count = len(world_from_cameras)
    if count < 2:
        raise InvalidInputError(
            f"{count} of the visited views have a place in the model; two are needed to align it.",
            hint="Begin with more views that overlap, or use `--poses known`.",
        )
    world = np.stack([view.translation for view in world_from_cameras])
    model = np.stack([view.translation for view in model_from_cameras])
    turns = np.stack(
        [
            of_model.rotation @ of_world.rotation.T
            for of_world, of_model in zip(world_from_cameras, model_from_cameras, strict=True)
        ]
    )
    transform, inliers, by_attitudes = _fit(world, model, turns)
    landed = transform.apply(world)
    misses = np.linalg.norm(landed - model, axis=1)[inliers]
    rms = float(np.sqrt(np.mean(misses**2))) / transform.scale
    attitude_deg = float(np.median(np.degrees(angle_between(transform.rotation, turns))))
    _require_agreement(rms, _spread(world[inliers]), attitude_deg, int(inliers.sum()), count)
    return ModelAlignment(
        transform,
        AlignmentRecord(
            source="attitudes" if by_attitudes else "centres",
            scale=transform.scale,
            rms=rms,
            attitude_deg=attitude_deg,
            views=count,
            inliers=int(inliers.sum()),
        ),
    )


def _fit(world: Array, model: Array, turns: Array) -> tuple[SimilarityTransform, NDArray[np.bool_], bool]:
    """The similarity, the views that agree on it, and whether attitudes had to fix its rotation."""
    inliers = np.ones(len(world), dtype=bool)
    if len(world) >= 3:
        report = _robust_fit(world, model)
        if not report.ill_conditioned:
            return report.transform, report.inliers, False
        inliers = report.inliers
    rotation = _mean_rotation(turns[inliers])
    world_middle, model_middle = world[inliers].mean(axis=0), model[inliers].mean(axis=0)
    turned = (world[inliers] - world_middle) @ rotation.T
    reach, lever = float((turned**2).sum()), float((turned * (model[inliers] - model_middle)).sum())
    if reach == 0 or lever <= 0:
        raise InvalidInputError(
            "The visited views' positions and attitudes contradict the photographs: no scale fits both.",
            hint=_HINT,
        )
    scale = lever / reach
    return SimilarityTransform(scale, rotation, model_middle - scale * rotation @ world_middle), inliers, True


def _robust_fit(world: Array, model: Array) -> AlignmentReport:
    """Least squares over all views but those that lie far from where the others put them.

    What is far is a share of the scene at first, which keeps every view of a handful; of more views also what
    stands out from the rest.
    """
    spread = float(np.median(np.linalg.norm(model - np.median(model, axis=0), axis=1)))
    try:
        report = robust_umeyama(world, model, inlier_threshold=max(_MAX_MISFIT * spread, 1e-300))
        if len(world) < _MANY:
            return report
        limit = max(3 * 1.4826 * report.median, 1e-6 * spread)
        return robust_umeyama(world, model, inlier_threshold=limit)
    except InvalidInputError as error:
        raise InvalidInputError(
            f"The dataset's positions cannot be aligned with the photographs: {error.message}", hint=_HINT
        ) from error


def _mean_rotation(turns: Array) -> Array:
    """The chordal mean of ``turns`` [N, 3, 3], without those that most contradict it."""
    mean = Rotation.from_matrix(turns).mean().as_matrix()
    for _ in range(3):
        angles = angle_between(mean, turns)
        agreeing = angles <= 2.5 * np.median(angles) + 1e-9
        mean = Rotation.from_matrix(turns[agreeing]).mean().as_matrix()
    return np.asarray(mean)


def _spread(centres: Array) -> float:
    return float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _require_agreement(rms: float, spread: float, attitude_deg: float, inliers: int, count: int) -> None:
    if rms > _MAX_MISFIT * spread or inliers < _MIN_INLIERS * count:
        raise InvalidInputError(
            f"The dataset's positions contradict the photographs: of {count} visited views {inliers} agree "
            f"on an alignment, and miss it by {rms:.3g} (RMS) where they are spread over {spread:.3g}.",
            hint=_HINT,
        )
    if attitude_deg > _MAX_ATTITUDE_DEG:
        raise InvalidInputError(
            f"The dataset's attitudes contradict the photographs: aligned by their positions, the cameras of "
            f"{count} visited views look {attitude_deg:.0f}° away (median) from where the model says.",
            hint=_HINT,
        )
