"""How uncertain the position of an image is that hangs on few points.

Sixty points in a corner of an image, three times as far away as its neighbours, leave its centre free by
several percent of the scene: it moves with the camera's rotation, and the points are seen nearly as well.
Adjustment takes the model's accuracy for theirs, so their own errors tell (ADR 47).
"""

import numpy as np
import pycolmap

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.colmap.model import rigid_from_pycolmap
from fvs_engine.sfm.native.known_points import camera_of
from fvs_engine.sfm.native.points_of_others import Rays, hangs_on_few_points, observations
from fvs_engine.sfm.native.pose_search import MIN_POSE_POINTS, MIN_SIGMA_PX
from fvs_engine.sfm.native.prior_pose import ExpectedPose, centre_sigma, project
from fvs_engine.sfm.native.robust_adjustment import MEDIAN_LENGTH

MAX_SHARE = 0.015
"""Maximum standard deviation of a position, in spreads of the camera centres: hardly any is 3 % off then."""


def uncertain_share(
    model: pycolmap.Reconstruction, image: pycolmap.Image, expected: ExpectedPose | None
) -> float | None:
    """The standard deviation of a registered image's position, in shares of the spread of the centres.

    In its least certain direction, by the points that others see and the ``expected`` pose. None where it is
    not above ``MAX_SHARE``, or too few points tell.
    """
    if not hangs_on_few_points(model, image):
        return None
    points, pixels = Rays(model).points_of_others(image, observations(image))
    if len(points) < MIN_POSE_POINTS:
        return None
    pose, camera = rigid_from_pycolmap(image.cam_from_world()), camera_of(image)
    seen, _ = project(camera, pose, points)
    error_px = float(np.median(np.linalg.norm(seen - pixels, axis=1)))
    noise_px = max(error_px / MEDIAN_LENGTH, MIN_SIGMA_PX)
    sigma = centre_sigma(pose, points, pixels, camera, noise_px, expected)
    centres = [model.image(image_id).projection_center() for image_id in model.reg_image_ids()]
    share = sigma / centre_spread(np.stack(centres))
    return share if share > MAX_SHARE else None
