"""The pose that explains an image's matches with known points best, of several that many agree with."""

from collections.abc import Iterator

import numpy as np
import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap
from fvs_engine.sfm.native.prior_pose import PoseProblem

MIN_POSE_POINTS = 30
"""Minimum number of points for estimating a pose; COLMAP's own limit."""

MIN_SIGMA_PX = 0.1
"""Minimum standard deviation of reprojection errors that is assumed: exact matches tell poses apart."""

_SEARCHES = (48.0, 16.0, 8.0, 4.0)
"""Errors in standard deviations up to which matches agree with a pose, in one search each.

COLMAP searches once, to 12 px. Matches that are a few pixels off then count as much as exact ones.
"""

_MIN_INLIER_RATIO = 0.1


def best_pose(start: RigidTransform, problem: PoseProblem, seed: int) -> RigidTransform:
    """The camera_from_model of the lowest robust cost: ``start`` or one found by RANSAC, refined."""
    # Beyond the reach of a strong distortion's model a pixel has no ray.
    has_ray = np.isfinite(np.asarray(problem.camera.cam_from_img(problem.pixels))).all(axis=1)
    if has_ray.sum() < MIN_POSE_POINTS:
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
    for sigmas in _SEARCHES:
        options = pycolmap.AbsolutePoseEstimationOptions()
        options.ransac.max_error = sigmas * problem.noise_px
        options.ransac.min_inlier_ratio = _MIN_INLIER_RATIO
        options.ransac.random_seed = seed
        answer = pycolmap.estimate_absolute_pose(problem.pixels, problem.points, problem.camera, options)
        if answer is not None:
            yield rigid_from_pycolmap(answer["cam_from_world"])
