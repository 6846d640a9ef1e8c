"""The poses of a dataset as pose priors, noisy as those of a vehicle are."""

import numpy as np

from fvs_engine.geometry import RigidTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.rotations import matrix_from_rotation_vector
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.settings import PriorNoise
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors


def dataset_priors(dataset: Dataset, noise: PriorNoise, seed: int) -> PosePriors:
    """Pose priors of all views, in the dataset's frame; the noise depends on ``seed`` and dataset only."""
    random = np.random.default_rng(seed)
    centres = np.stack([view.centre for view in dataset.views])
    sigma = noise.position_share * centre_spread(centres)
    by_name = {}
    for view, centre in zip(dataset.views, centres, strict=True):
        turn = matrix_from_rotation_vector(np.deg2rad(noise.orientation_deg) * random.normal(size=3))
        world_from_camera = RigidTransform(
            turn @ view.camera_from_model.rotation.T, centre + sigma * random.normal(size=3)
        )
        by_name[view.name] = PosePrior.of_camera(world_from_camera, sigma, noise.orientation_deg)
    return PosePriors(by_name=by_name)
