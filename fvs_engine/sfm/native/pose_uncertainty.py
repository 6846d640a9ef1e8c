"""How uncertain the position of an image is that hangs on few points.

Where nearly all points are in one part of an image, its centre moves with the camera's rotation, and the
points are seen nearly as well. Matches along one edge are wrong in the same direction, so the covariance of a
least squares fit, which takes errors as independent, is far too small. Estimates without one part of the
image after another tell what the position hangs on (docs/design/poses.md).
"""

import numpy as np
import pycolmap

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap
from fvs_engine.sfm.native.known_points import camera_of
from fvs_engine.sfm.native.points_of_others import Rays, hangs_on_few_points, observations
from fvs_engine.sfm.native.prior_pose import Array, PoseProblem, project
from fvs_engine.sfm.native.robust_adjustment import MEDIAN_LENGTH
from fvs_engine.sfm.native.thresholds import POSES
from fvs_schema.findings import Finding, FindingCode


def position_share(model: pycolmap.Reconstruction, image: pycolmap.Image, rays: Rays) -> float | None:
    """The standard deviation of a registered image's position, in spreads of the camera centres.

    It is that of the least certain direction, estimated from the points that other images see, without the
    image's prior. None for an image that does not hang on few points, and for too few points or images.
    """
    if model.num_reg_images() < POSES.min_cameras or not hangs_on_few_points(model, image):
        return None
    points, pixels = rays.points_of_others(image, observations(image))
    if len(points) < POSES.min_judged_points:
        return None
    sigma = centre_sigma(rigid_from_pycolmap(image.cam_from_world()), points, pixels, camera_of(image))
    centres = [model.image(image_id).projection_center() for image_id in model.reg_image_ids()]
    return sigma / max(centre_spread(np.stack(centres)), 1e-12)  # photographs turned in place have none


def why_uncertain(name: str, share: float) -> Finding:
    """The reason for rejecting an image with that ``position_share``."""
    if np.isinf(share):
        return Finding.of(FindingCode.POSE_UNDETERMINED, [name])
    return Finding.of(FindingCode.POSE_UNCERTAIN, [name], share=share)


def centre_sigma(
    camera_from_model: RigidTransform, points: Array, pixels: Array, camera: pycolmap.Camera
) -> float:
    """The standard deviation of the camera centre in its least certain direction.

    The pose is the one near ``camera_from_model`` that explains the ``pixels`` [N, 2] of ``points`` [N, 3]
    best, with known intrinsics. Estimated by the delete-a-group jackknife, whose groups are cells of the
    image; infinite where one cell has nearly all points.
    """
    seen, _ = project(camera, camera_from_model, points)
    error_px = float(np.median(np.linalg.norm(seen - pixels, axis=1)))
    noise_px = max(error_px / MEDIAN_LENGTH, POSES.min_sigma_px)
    cells = np.floor(pixels / (camera.width, camera.height) * POSES.cells) @ (POSES.cells[1], 1)
    try:
        problem = PoseProblem(points, pixels, camera, noise_px)
        pose = problem.refine(camera_from_model)
        centres = []
        for cell in np.unique(cells):
            kept = cells != cell
            if kept.sum() < POSES.min_points_left:
                return np.inf
            centres.append(problem.of(kept).refine(pose).inverse().translation)
    except (InvalidInputError, np.linalg.LinAlgError):  # no point is ahead of it
        return np.inf
    shifts = np.stack(centres) - pose.inverse().translation
    covariance = (len(centres) - 1) / len(centres) * shifts.T @ shifts
    return float(np.sqrt(max(np.linalg.eigvalsh(covariance)[-1], 0.0)))
