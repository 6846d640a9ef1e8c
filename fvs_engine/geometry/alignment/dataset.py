"""Alignment of a dataset with a model by the views that both have: ``model_from_world``.

Source: the paper, section III (Kabsch–Umeyama over the visited views' positions). It takes the first ten
views; here all visited ones count, so that the alignment follows a growing model, and single wrongly
registered views become outliers.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import AlignmentReport, robust_umeyama
from fvs_engine.geometry.rotations import angle_between
from fvs_engine.geometry.transforms import RigidTransform, SimilarityTransform

Array = NDArray[np.float64]

_MAX_MISFIT = 0.25
"""Largest RMS distance of aligned centres in shares of their spread: more than that of a plain GPS track."""

_MAX_ATTITUDE_DEG = 20.0
"""Largest median angle between aligned attitudes: above a gimbal's error, below that of a wrong axis."""

_MANY = 10
"""From this number of views on, outliers are also defined by their residuals."""

_MIN_INLIERS = 0.5
"""Share of the views that must agree."""


@dataclass(frozen=True, eq=False)
class DatasetAlignment:
    """``model_from_world``, and how well ``inliers`` of ``views`` views agree with it.

    ``source``: ``known`` when the two are one frame; ``centres`` when the camera centres fixed the
    similarity; ``attitudes`` when they lie on a line, and the cameras' attitudes fixed its rotation. ``rms``:
    of the inliers' centres, in the dataset's unit. ``attitude_deg``: median angle between the attitudes that
    the dataset and the model give a view.
    """

    model_from_world: SimilarityTransform
    source: Literal["known", "centres", "attitudes"]
    rms: float
    attitude_deg: float
    views: int
    inliers: int


def same_frame(views: int) -> DatasetAlignment:
    """The alignment of a model whose frame is the dataset's."""
    return DatasetAlignment(SimilarityTransform.identity(), "known", 0.0, 0.0, views, views)


def align_dataset(
    world_from_cameras: Sequence[RigidTransform], model_from_cameras: Sequence[RigidTransform]
) -> DatasetAlignment:
    """Align the dataset's frame with the model's by matching cameras of at least two views.

    Centres fix the similarity, robustly. Where they do not determine the rotation (two views; a straight
    track) the mean rotation of the attitudes is used, and centres fix the rest.

    Raises ``InvalidInputError`` for fewer than two views, centres that coincide, and poses that contradict
    the model: centres or attitudes far apart after the best alignment.
    """
    count = len(world_from_cameras)
    if count < 2:
        raise InvalidInputError(
            f"{count} of the visited views are registered in the model; two are needed to align it."
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
    _require_agreement(rms, centre_spread(world[inliers]), attitude_deg, int(inliers.sum()), count)
    return DatasetAlignment(
        transform,
        "attitudes" if by_attitudes else "centres",
        rms,
        attitude_deg,
        views=count,
        inliers=int(inliers.sum()),
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
            "The visited views' positions and attitudes contradict the photographs: no scale fits both."
        )
    scale = lever / reach
    return SimilarityTransform(scale, rotation, model_middle - scale * rotation @ world_middle), inliers, True


def _robust_fit(world: Array, model: Array) -> AlignmentReport:
    """Least squares over all views but outliers.

    At first an outlier is off by a share of the scene's extent, which keeps every view of a handful; with
    more views also by much more than the median.
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
            f"The dataset's positions cannot be aligned with the photographs: {error.message}"
        ) from error


def _mean_rotation(turns: Array) -> Array:
    """The chordal mean of ``turns`` [N, 3, 3], without those farthest from it."""
    mean = Rotation.from_matrix(turns).mean().as_matrix()
    for _ in range(3):
        angles = angle_between(mean, turns)
        agreeing = angles <= 2.5 * np.median(angles) + 1e-9
        mean = Rotation.from_matrix(turns[agreeing]).mean().as_matrix()
    return np.asarray(mean)


def _require_agreement(rms: float, spread: float, attitude_deg: float, inliers: int, count: int) -> None:
    if rms > _MAX_MISFIT * spread or inliers < _MIN_INLIERS * count:
        raise InvalidInputError(
            f"The dataset's positions contradict the photographs: of {count} visited views {inliers} agree "
            f"on an alignment, and miss it by {rms:.3g} (RMS) where they are spread over {spread:.3g}."
        )
    if attitude_deg > _MAX_ATTITUDE_DEG:
        raise InvalidInputError(
            f"The dataset's attitudes contradict the photographs: aligned by positions, the attitudes of "
            f"{count} visited views differ by {attitude_deg:.0f}° (median) from those of the model."
        )
