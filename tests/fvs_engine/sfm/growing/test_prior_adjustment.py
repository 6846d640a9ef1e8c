"""Position priors take the drift out of a long row of cameras."""

import numpy as np
import pycolmap
import pytest
from row_of_cameras import COUNT, STEP, error_of_centres, row_of_cameras, true_poses
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import SimilarityTransform
from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.native.prior_adjustment import adjust_with_priors
from fvs_engine.sfm.native.robust_adjustment import RobustAdjustment
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors

WORLD = SimilarityTransform(
    7.0, Rotation.from_rotvec([0.3, 1.2, -0.5]).as_matrix(), np.array([5.0, -80.0, 30.0])
)
SIGMA = 0.02 * 7.0 * STEP * COUNT / 4


def adjustment(model: pycolmap.Reconstruction) -> RobustAdjustment:
    return RobustAdjustment(model, refine=False, lens=False, threads=1)


def priors(*wrong: int) -> PosePriors:
    """Noisy positions; those of the cameras with the numbers ``wrong`` are far off."""
    random = np.random.default_rng(1)
    by_name = {}
    for k, (name, pose) in enumerate(true_poses().items()):
        place = WORLD.apply(pose.inverse().translation) + random.normal(0.0, SIGMA, 3)
        by_name[name] = PosePrior.at(place + (40.0 if k in wrong else 0.0), SIGMA)
    return PosePriors(by_name=by_name)


def adjusted(model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """``model`` after bundle adjustment without priors."""
    adjustment(model).solve()
    return model


@pytest.mark.parametrize("wrong", [(), (8, 15)])
def test_priors_take_out_drift_also_when_some_are_wrong(wrong: tuple[int, ...]):
    model = adjusted(row_of_cameras(1.5, 3))
    drifted = error_of_centres(model)
    assert drifted > 0.02
    assert adjust_with_priors(adjustment(model), priors(*wrong), 0)
    assert error_of_centres(model) < 0.7 * drifted


def test_priors_do_not_hurt_where_points_fix_the_cameras():
    model = adjusted(row_of_cameras(0.3, 8))
    before = error_of_centres(model)
    assert adjust_with_priors(adjustment(model), priors(), 0)
    assert error_of_centres(model) < 1.05 * before


def test_priors_that_contradict_the_model_change_nothing():
    model = adjusted(row_of_cameras(0.3, 8))
    before = camera_poses(model)
    places = list(priors().by_name.values())
    swapped = PosePriors(
        by_name=dict(zip(sorted(before), np.random.default_rng(2).permutation(places), strict=True))
    )
    assert not adjust_with_priors(adjustment(model), swapped, 0)
    after = camera_poses(model)
    assert all(np.array_equal(before[name].matrix, after[name].matrix) for name in before)
