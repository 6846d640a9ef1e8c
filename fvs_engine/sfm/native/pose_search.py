"""The pose that explains an image's matches with known points best, of several that many agree with."""

from collections.abc import Iterator

import numpy as np
import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap
from fvs_engine.sfm.native.prior_pose import PoseProblem
from fvs_engine.sfm.native.thresholds import POSES


def best_pose(start: RigidTransform, problem: PoseProblem, seed: int) -> RigidTransform:
    """The camera_from_model of the lowest robust cost: ``start`` or one found by RANSAC, refined."""
    # Beyond the reach of a strong distortion's model a pixel has no ray.
    has_ray = np.isfinite(np.asarray(problem.camera.cam_from_img(problem.pixels))).all(axis=1)
    if has_ray.sum() < POSES.min_points:
        return start
    problem = problem.of(has_ray)
    poses = [start]
    for pose in (start, *_found(problem, seed)):
        try:
            poses.append(problem.refine(pose))
        except (InvalidInputError, np.linalg.LinAlgError):  # no point is ahead of it
            continue
    return min(poses, key=problem.cost)


def _found(problem: PoseProblem, seed: int) -> Iterator[RigidTransform]:
    """The pose that most matches agree with, for each limit of agreement."""
    for sigmas in POSES.search_sigmas:
        options = pycolmap.AbsolutePoseEstimationOptions()
        options.ransac.max_error = sigmas * problem.noise_px
        options.ransac.min_inlier_ratio = POSES.min_inlier_ratio
        options.ransac.random_seed = seed
        answer = pycolmap.estimate_absolute_pose(problem.pixels, problem.points, problem.camera, options)
        if answer is not None:
            yield rigid_from_pycolmap(answer["cam_from_world"])
