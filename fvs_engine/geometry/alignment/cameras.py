"""Alignment of two models by the poses of the cameras that they share."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from fvs_engine.geometry.alignment.similarity import AlignmentReport, robust_umeyama
from fvs_engine.geometry.transforms import RigidTransform

Array = NDArray[np.float64]


def align_poses(new: Mapping[str, RigidTransform], current: Mapping[str, RigidTransform]) -> AlignmentReport:
    """Robust Umeyama from ``new`` to ``current`` (name → model_from_camera each), over the names in both.

    Every camera gives its centre and a point on each of its axes, so that cameras on a straight line fix the
    rotation about it too. Raises ``InvalidInputError`` when the shared centres coincide or nothing agrees.
    """
    shared = sorted(new.keys() & current.keys())
    source, target = (np.array([poses[name].translation for name in shared]) for poses in (new, current))
    length = centre_spread(source) if shared else 0.0
    return robust_umeyama(
        _corners(new, shared, length), _corners(current, shared, length * _median_scale(source, target))
    )


def _median_scale(source: Array, target: Array) -> float:
    """Target lengths per source length, median over all pairs of matching points [N, 3]."""
    lengths = pdist(source.reshape(-1, 3))
    known = lengths > 0
    return float(np.median(pdist(target.reshape(-1, 3))[known] / lengths[known])) if known.any() else 1.0


def centre_spread(centres: Array) -> float:
    """Root mean square distance of centres [N, 3] from their mean."""
    return float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _corners(poses: Mapping[str, RigidTransform], names: list[str], length: float) -> Array:
    """Centres and the tips of axes of this length, [4 N, 3]."""
    centres = np.array([poses[name].translation for name in names]).reshape(-1, 3)
    axes = np.array([poses[name].rotation for name in names]).reshape(-1, 3, 3)
    return np.concatenate([centres, *(centres + length * axes[:, :, axis] for axis in range(3))])


def mean_rotation(rotations: Array) -> Array:
    """The rotation [3, 3] nearest to all of ``rotations`` [N, 3, 3], in the sense of the chordal distance."""
    U, _, Vt = np.linalg.svd(rotations.mean(axis=0))
    return np.asarray(U @ np.diag([1.0, 1.0, np.linalg.det(U @ Vt)]) @ Vt)
