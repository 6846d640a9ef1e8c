"""Pose priors of images for structure from motion."""

from collections.abc import Mapping

import numpy as np

from fvs_engine.geometry.geodetic import camera_at
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_schema.images import Image, Prior, PriorSource
from fvs_schema.scenes import Origin
from fvs_service.snapshots.georeferencing import position_sigma_m, world_position

_ATTITUDE_SIGMA_DEG = 10.0
"""The default: a gimbal's pitch and roll are good to a degree or two, its compass is not."""


def pose_priors(images: Mapping[str, Image], origin: Origin | None) -> PosePriors | None:
    """The pose priors of ``images`` (by file name) in the world frame with this ``origin``.

    None when no request gave a position or its accuracy and no image has an attitude: structure from motion
    reads the positions in the files itself.
    """
    found = {
        name: (image.prior, position)
        for name, image in images.items()
        if image.prior is not None and (position := world_position(image.prior, origin)) is not None
    }
    if not any(_tells_more_than_the_file(prior) for prior, _ in found.values()):
        return None
    return PosePriors(
        by_name={name: _pose_prior(prior, position) for name, (prior, position) in found.items()}
    )


def _tells_more_than_the_file(prior: Prior) -> bool:
    whole = prior.yaw_deg is not None and prior.pitch_deg is not None
    return prior.source is PriorSource.REQUEST or whole or prior.position_sigma_m is not None


def _pose_prior(prior: Prior, position: np.ndarray) -> PosePrior:
    """The position, and the orientation where it is known; a photograph without a roll is upright."""
    sigma_m, attitude_sigma_deg = position_sigma_m(prior), prior.attitude_sigma_deg
    if attitude_sigma_deg is None:
        attitude_sigma_deg = _ATTITUDE_SIGMA_DEG
    if prior.yaw_deg is None or prior.pitch_deg is None:
        return PosePrior.at(position, sigma_m)
    world_from_camera = camera_at(position, prior.yaw_deg, prior.pitch_deg, prior.roll_deg or 0.0)
    return PosePrior.of_camera(world_from_camera, sigma_m, attitude_sigma_deg)
