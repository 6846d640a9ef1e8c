"""Bundle adjustment with the position priors of the images as robust residuals, against drift."""

import numpy as np
import pycolmap

from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.sfm.colmap.model import camera_poses, move
from fvs_engine.sfm.native.robust_adjustment import RobustAdjustment
from fvs_engine.sfm.native.thresholds import ADJUSTMENT
from fvs_engine.sfm.pose_priors import PosePriors
from fvs_engine.sfm.verification.positions import misplaced
from fvs_engine.sfm.verification.prior_frame import believed_frame


def adjust_with_priors(adjustment: RobustAdjustment, priors: PosePriors, seed: int) -> bool:
    """Adjust cameras and points to the images and, if they are credible, to the position priors.

    Priors far from their cameras are left out, and those that fit badly have less weight. Afterwards the
    model is in the frame of the priors. Returns whether anything was adjusted.
    """
    model = adjustment.model
    poses = camera_poses(model)
    frame = believed_frame(priors, poses)
    if frame is None:
        return False
    wrong = misplaced(priors, {name: pose.translation for name, pose in poses.items()})
    move(model, frame.world_from_model)
    images = [model.image(image_id) for image_id in model.reg_image_ids()]
    known = [image for image in images if image.name in priors.by_name and image.name not in wrong]
    world = priors.positions([image.name for image in known])
    least = ADJUSTMENT.min_prior_sigma_share * centre_spread(world)
    positions = []
    for image in known:
        prior = priors.by_name[image.name]
        position = pycolmap.PosePrior()
        position.pose_prior_id, position.corr_data_id = image.image_id, image.data_id
        position.position = np.array(prior.position)
        # Reprojection errors are in px, not in their standard deviations; so priors are in those units, too.
        sigma = max(prior.position_sigma, least) / adjustment.sigma_px
        position.position_covariance = sigma**2 * np.eye(3)
        position.coordinate_system = pycolmap.PosePriorCoordinateSystem.CARTESIAN
        positions.append(position)
    robust = pycolmap.PosePriorBundleAdjustmentOptions()
    robust.ceres.prior_position_loss_function_type = pycolmap.LossFunctionType.CAUCHY
    robust.alignment_ransac.random_seed = seed
    adjustment.run(
        lambda: pycolmap.create_pose_prior_bundle_adjuster(
            adjustment.options, robust, adjustment.config, positions, model
        )
    )
    return True
