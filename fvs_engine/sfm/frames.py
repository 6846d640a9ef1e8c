"""Lay a new model of the same photographs onto the standing one: the model frame does not move."""

from collections.abc import Mapping

import numpy as np
import pycolmap
from numpy.typing import NDArray

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment import AlignmentReport, robust_umeyama
from fvs_engine.sfm.evidence import centre_spread
from fvs_engine.sfm.reconstruction import rigid_from_pycolmap

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
    return robust_umeyama(_corners(new, shared), _corners(standing, shared))


def move(model: pycolmap.Reconstruction, alignment: AlignmentReport) -> None:
    """Apply the alignment's transform to all cameras and points of ``model``."""
    transform = alignment.transform
    model.transform(
        pycolmap.Sim3d(transform.scale, pycolmap.Rotation3d(transform.rotation), transform.translation)
    )


def _corners(poses: Mapping[str, RigidTransform], names: list[str]) -> Array:
    """Centres and axis tips [4 N, 3]; the axes are as long as the centres are spread in this model."""
    if not names:
        return np.zeros((0, 3))
    centres = np.stack([poses[name].translation for name in names])
    length = centre_spread(centres)
    tips = [
        centres + length * np.stack([poses[name].rotation[:, axis] for name in names]) for axis in range(3)
    ]
    return np.concatenate([centres, *tips])
