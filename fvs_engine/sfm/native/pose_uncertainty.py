"""How uncertain the position of an image is that hangs on few points.

Where nearly all points are in one part of an image, its centre moves with the camera's rotation, and the
points are seen nearly as well. Matches along one edge are wrong in the same direction, so the covariance of a
least squares fit, which takes errors as independent, is far too small. Estimates without one part of the
image after another tell what the position hangs on (ADR 47).
"""

import numpy as np
import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap
from fvs_engine.sfm.native.known_points import camera_of
from fvs_engine.sfm.native.points_of_others import Rays, hangs_on_few_points, observations
from fvs_engine.sfm.native.pose_search import MIN_POSE_POINTS, MIN_SIGMA_PX
from fvs_engine.sfm.native.prior_pose import Array, project, refine
from fvs_engine.sfm.native.robust_adjustment import MEDIAN_LENGTH

MAX_SHARE = 0.02
"""Maximum standard deviation of a position, in spreads of the camera centres."""

_CELLS = (6, 4)
"""Columns and rows of the parts of an image. A sixth of it has often all matches of one edge or surface."""

_LEAST_POINTS = 6
"""Without a cell there must remain as many: three suffice for a pose, and say nothing about its errors."""


def why_uncertain(model: pycolmap.Reconstruction, image: pycolmap.Image) -> str | None:
    """Why the position of a registered image is uncertain, by the points that other images see.

    None where the standard deviation in its least certain direction is at most ``MAX_SHARE`` of the spread of
    the camera centres, or too few points tell. The image's prior does not count.
    """
    if not hangs_on_few_points(model, image):
        return None
    points, pixels = Rays(model).points_of_others(image, observations(image))
    if len(points) < MIN_POSE_POINTS:
        return None
    sigma = centre_sigma(rigid_from_pycolmap(image.cam_from_world()), points, pixels, camera_of(image))
    centres = [model.image(image_id).projection_center() for image_id in model.reg_image_ids()]
    spread = centre_spread(np.stack(centres))
    if sigma <= MAX_SHARE * spread:
        return None
    if np.isinf(sigma):
        return "nearly all of its matches are in one part of it, and leave its position uncertain"
    return f"its matches leave its position uncertain by {sigma / spread:.0%} of the spread of all positions"


def centre_sigma(
    camera_from_model: RigidTransform, points: Array, pixels: Array, camera: pycolmap.Camera
) -> float:
    """The standard deviation of the camera centre in its least certain direction.

    Of the pose near ``camera_from_model`` that explains the ``pixels`` [N, 2] of ``points`` [N, 3] best: by
    the delete-a-group jackknife, whose groups are cells of the image. Infinite where one cell has nearly all.
    """
    seen, _ = project(camera, camera_from_model, points)
    error_px = float(np.median(np.linalg.norm(seen - pixels, axis=1)))
    noise_px = max(error_px / MEDIAN_LENGTH, MIN_SIGMA_PX)
    cells = np.floor(pixels / (camera.width, camera.height) * _CELLS) @ (_CELLS[1], 1)
    try:
        pose = refine(camera_from_model, points, pixels, camera, noise_px, None)
        centres = []
        for cell in np.unique(cells):
            kept = cells != cell
            if kept.sum() < _LEAST_POINTS:
                return np.inf
            without = refine(pose, points[kept], pixels[kept], camera, noise_px, None)
            centres.append(without.inverse().translation)
    except (InvalidInputError, np.linalg.LinAlgError):  # no point is ahead of it
        return np.inf
    shifts = np.stack(centres) - pose.inverse().translation
    covariance = (len(centres) - 1) / len(centres) * shifts.T @ shifts
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
