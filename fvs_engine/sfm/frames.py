"""Lay a new model of the same photographs onto the standing one: the model frame does not move."""

from collections.abc import Mapping

import numpy as np
import pycolmap
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.similarity import AlignmentReport, robust_umeyama
from fvs_engine.sfm.reconstruction import rigid_from_pycolmap
from fvs_engine.sfm.verification.evidence import centre_spread

Array = NDArray[np.float64]


def camera_poses(model: pycolmap.Reconstruction) -> dict[str, RigidTransform]:
    """Name → model_from_camera of the images that have a pose."""
    return {
        image.name: rigid_from_pycolmap(image.cam_from_world()).inverse()
        for image in model.images.values()
        if image.has_pose
    }


def align_poses(new: Mapping[str, RigidTransform], standing: Mapping[str, RigidTransform]) -> AlignmentReport:
    """Robust Umeyama from ``new`` to ``standing`` (model_from_camera each), over the images in both.

    Every camera gives its centre and a point on each of its axes, so that cameras on a straight line fix the
    rotation about it too. Raises ``InvalidInputError`` when the shared centres coincide or nothing agrees.
    """
    shared = sorted(new.keys() & standing.keys())
    source, target = (np.array([poses[name].translation for name in shared]) for poses in (new, standing))
    length = centre_spread(source) if shared else 0.0
    return robust_umeyama(
        _corners(new, shared, length), _corners(standing, shared, length * _median_scale(source, target))
    )


def _median_scale(source: Array, target: Array) -> float:
    """Target lengths per source length, median over all pairs of matching points [N, 3]."""
    lengths = pdist(source.reshape(-1, 3))
    known = lengths > 0
    return float(np.median(pdist(target.reshape(-1, 3))[known] / lengths[known])) if known.any() else 1.0


def move(model: pycolmap.Reconstruction, alignment: AlignmentReport) -> None:
    """Apply the alignment's transform to all cameras and points of ``model``."""
    transform = alignment.transform
    model.transform(
        pycolmap.Sim3d(transform.scale, pycolmap.Rotation3d(transform.rotation), transform.translation)
    )


def _corners(poses: Mapping[str, RigidTransform], names: list[str], length: float) -> Array:
    """Centres and the tips of axes of this length, [4 N, 3]."""
    centres = np.array([poses[name].translation for name in names]).reshape(-1, 3)
    axes = np.array([poses[name].rotation for name in names]).reshape(-1, 3, 3)
    return np.concatenate([centres, *(centres + length * axes[:, :, axis] for axis in range(3))])
