"""Position priors take the drift out of a long row of cameras."""

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform, SimilarityTransform
from fvs_engine.geometry.alignment.cameras import centre_spread
from fvs_engine.geometry.alignment.similarity import umeyama
from fvs_engine.sfm.colmap.model import camera_poses, rigid_to_pycolmap
from fvs_engine.sfm.native.prior_adjustment import adjust_with_priors
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors

COUNT, STEP, EACH = 24, 1.0, 12
WORLD = SimilarityTransform(
    7.0, Rotation.from_rotvec([0.3, 1.2, -0.5]).as_matrix(), np.array([5.0, -80.0, 30.0])
)
SIGMA = 0.02 * 7.0 * STEP * COUNT / 4


def true_poses() -> dict[str, RigidTransform]:
    """camera_from_model of cameras on a bent row, which look across it."""
    poses = {}
    for k in range(COUNT):
        centre = np.array([k * STEP, 0.3 * np.sin(0.7 * k), 2.0 * np.sin(0.15 * k)])
        rotation = Rotation.from_rotvec([0.05 * np.sin(k), 0.1 * np.cos(2 * k), 0.0]).as_matrix()
        poses[f"{k:02}.jpg"] = RigidTransform(rotation, -rotation @ centre)
    return poses


def row_of_cameras(noise_px: float, seen_by: int) -> pycolmap.Reconstruction:
    """A model with true poses, whose points are each seen by ``seen_by`` neighbours in the row."""
    random = np.random.default_rng(0)
    model = pycolmap.Reconstruction()
    camera = pycolmap.Camera(
        model="SIMPLE_PINHOLE", width=800, height=600, params=np.array([700.0, 400.0, 300.0]), camera_id=1
    )
    model.add_camera_with_trivial_rig(camera)
    poses = true_poses()
    points, seen = [], {name: [] for name in poses}
    names = list(poses)
    for first in range(COUNT - seen_by + 1):
        middle = STEP * (first + (seen_by - 1) / 2)
        for xyz in random.uniform([middle - 1.0, -1.5, 6.0], [middle + 1.0, 1.5, 9.0], (EACH, 3)):
            for name in names[first : first + seen_by]:
                pixel = np.asarray(camera.img_from_cam(poses[name].apply(xyz[None])))[0]
                seen[name].append((len(points), pixel + random.normal(0.0, noise_px, 2)))
            points.append(xyz)
    tracks = [pycolmap.Track() for _ in points]
    for number, name in enumerate(names, start=1):
        pixels = np.array([pixel for _, pixel in seen[name]])
        image = pycolmap.Image(name=name, keypoints=pixels, camera_id=1, image_id=number)
        model.add_image_with_trivial_frame(image, rigid_to_pycolmap(poses[name]))
        for feature, (point, _) in enumerate(seen[name]):
            tracks[point].add_element(number, feature)
    for xyz, track in zip(points, tracks, strict=True):
        model.add_point3D(xyz, track, np.zeros(3, np.uint8))
    return model


def options() -> pycolmap.BundleAdjustmentOptions:
    chosen = pycolmap.BundleAdjustmentOptions()
    chosen.print_summary = False
    chosen.refine_focal_length = chosen.refine_extra_params = False
    return chosen


def priors(*wrong: int) -> PosePriors:
    """Noisy positions; those of the cameras with the numbers ``wrong`` are far off."""
    random = np.random.default_rng(1)
    by_name = {}
    for k, (name, pose) in enumerate(true_poses().items()):
        place = WORLD.apply(pose.inverse().translation) + random.normal(0.0, SIGMA, 3)
        by_name[name] = PosePrior.at(place + (40.0 if k in wrong else 0.0), SIGMA)
    return PosePriors(by_name=by_name)


def error(model: pycolmap.Reconstruction) -> float:
    """Root mean square of the distances from the truth, in shares of the spread."""
    truth, found = true_poses(), camera_poses(model)
    theirs = np.stack([truth[name].inverse().translation for name in sorted(found)])
    ours = np.stack([found[name].translation for name in sorted(found)])
    off = np.linalg.norm(umeyama(ours, theirs).apply(ours) - theirs, axis=1)
    return float(np.sqrt((off**2).mean()) / centre_spread(theirs))


def adjusted(model: pycolmap.Reconstruction) -> pycolmap.Reconstruction:
    """``model`` after bundle adjustment without priors."""
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options(), config, model).solve()
    return model


@pytest.mark.parametrize("wrong", [(), (8, 15)])
def test_priors_take_out_drift_also_when_some_are_wrong(wrong: tuple[int, ...]):
    model = adjusted(row_of_cameras(1.5, 3))
    drifted = error(model)
    assert drifted > 0.02
    assert adjust_with_priors(model, priors(*wrong), options(), 0)
    assert error(model) < 0.7 * drifted


def test_priors_do_not_hurt_where_points_fix_the_cameras():
    model = adjusted(row_of_cameras(0.3, 8))
    before = error(model)
    assert adjust_with_priors(model, priors(), options(), 0)
    assert error(model) < 1.05 * before


def test_priors_that_contradict_the_model_change_nothing():
    model = adjusted(row_of_cameras(0.3, 8))
    before = camera_poses(model)
    places = list(priors().by_name.values())
    swapped = PosePriors(
        by_name=dict(zip(sorted(before), np.random.default_rng(2).permutation(places), strict=True))
    )
    assert not adjust_with_priors(model, swapped, options(), 0)
    after = camera_poses(model)
    assert all(np.array_equal(before[name].matrix, after[name].matrix) for name in before)
