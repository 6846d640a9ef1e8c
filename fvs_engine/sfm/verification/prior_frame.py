"""The frame of pose priors: the similarity from a model to their world, where they fit the model."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform, SimilarityTransform
from fvs_engine.geometry.alignment.cameras import centre_spread, mean_rotation
from fvs_engine.geometry.alignment.similarity import AlignmentReport
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.verification.pair_check import angle_deg, vector_angle_deg
from fvs_engine.sfm.verification.positions import fit_priors
from fvs_engine.sfm.verification.thresholds import PRIORS

Array = NDArray[np.float64]

_MEDIAN_LENGTH = 1.54
"""Of vectors whose three coordinates have the standard deviation 1."""


@dataclass(frozen=True, eq=False)
class PriorFrame:
    """The similarity from a model to the world of believed priors, and whether orientations are believed.

    ``aligned``: the registered images whose positions agree with the model. ``position_noise`` and
    ``orientation_noise_deg``: standard deviations, of a coordinate and about an axis, that the priors of
    registered images show, whatever they claim.
    """

    world_from_model: SimilarityTransform
    oriented: bool
    aligned: tuple[str, ...]
    position_noise: float
    orientation_noise_deg: float


def believed_frame(priors: PosePriors, poses: Mapping[str, RigidTransform]) -> PriorFrame | None:
    """The similarity between the priors and a model; None when they do not agree well enough to be believed.

    ``poses``: name → model_from_camera of the registered images. Where the centres lie on a line, the
    orientations fix the rotation about it; orientations that contradict the positions are left out.
    """
    centres = {name: pose.translation for name, pose in poses.items()}
    shared = sorted(centres.keys() & priors.by_name.keys())
    fit = fit_priors(priors, centres)
    if fit is None or fit.contradicts:
        return None
    report = fit.report
    by_orientations = _rotation_by_orientations(priors, poses)
    if by_orientations is not None and not _fits(by_orientations, report, priors, centres, shared):
        by_orientations = None
    world_from_model = report.transform
    if report.ill_conditioned:
        if by_orientations is None:
            return None
        middle, scale = np.mean([centres[name] for name in shared], axis=0), report.transform.scale
        moved = report.transform.apply(middle) - scale * by_orientations @ middle
        world_from_model = SimilarityTransform(scale, by_orientations, moved)
    oriented = by_orientations is not None
    off_deg = [angle_deg(world_from_model.rotation @ turn.T) for turn in _turns(priors, poses) if oriented]
    return PriorFrame(
        world_from_model,
        oriented,
        tuple(name for name, agrees in zip(shared, report.inliers, strict=True) if agrees),
        report.median / _MEDIAN_LENGTH,
        float(np.median(off_deg)) / _MEDIAN_LENGTH if oriented else 0.0,
    )


def is_vague(prior: PosePrior, priors: PosePriors, frame: PriorFrame) -> bool:
    """Whether a prior, by its own standard deviations, does not tell what its image should show."""
    world = priors.positions(list(frame.aligned))
    return (
        prior.position_sigma > PRIORS.max_position_share * centre_spread(world)
        or prior.orientation_sigma_deg > PRIORS.max_orientation_deg
    )


def orientations_contradict(priors: PosePriors, poses: Mapping[str, RigidTransform]) -> bool:
    """Whether the orientations contradict each other, or positions that agree with the model."""
    oriented = [
        name for name in poses if name in priors.by_name and priors.by_name[name].rotation is not None
    ]
    if len(oriented) < PRIORS.min_orientations:
        return False
    by_orientations = _rotation_by_orientations(priors, poses)
    if by_orientations is None:
        return True
    centres = {name: pose.translation for name, pose in poses.items()}
    shared = sorted(centres.keys() & priors.by_name.keys())
    fit = fit_priors(priors, centres)
    if fit is None or fit.contradicts:
        return False
    return not _fits(by_orientations, fit.report, priors, centres, shared)


def _fits(
    rotation: Array,
    report: AlignmentReport,
    priors: PosePriors,
    centres: Mapping[str, Array],
    shared: list[str],
) -> bool:
    """Whether a rotation world_from_model fits the positions; on a line they leave the turn about it open."""
    if not report.ill_conditioned:
        return angle_deg(rotation @ report.transform.rotation.T) <= PRIORS.max_turn_deg
    model = np.stack([centres[name] for name in shared])[report.inliers]
    world = priors.positions(shared)[report.inliers]
    turned = (model - model.mean(axis=0)) @ rotation.T
    return vector_angle_deg(turned.ravel(), (world - world.mean(axis=0)).ravel()) <= PRIORS.max_turn_deg


def _rotation_by_orientations(priors: PosePriors, poses: Mapping[str, RigidTransform]) -> Array | None:
    """world_from_model's rotation by the orientations that agree, more than half; None without them."""
    turns = _turns(priors, poses)
    if len(turns) < PRIORS.min_orientations:
        return None
    angles = np.array([[angle_deg(a @ b.T) for b in turns] for a in turns])
    middle = int(np.argmin(np.median(angles, axis=1)))
    agreeing = angles[middle] <= PRIORS.max_turn_deg
    if agreeing.sum() <= len(turns) / 2:
        return None
    return mean_rotation(np.stack(turns)[agreeing])


def _turns(priors: PosePriors, poses: Mapping[str, RigidTransform]) -> list[Array]:
    """world_from_model's rotation by each orientation of a registered image."""
    return [
        prior.rotation @ poses[name].rotation.T
        for name, prior in sorted(priors.by_name.items())
        if name in poses and prior.rotation is not None
    ]
