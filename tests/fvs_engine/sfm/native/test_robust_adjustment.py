"""Robust bundle adjustment: wrong matches, lenses, and cameras that it must not change."""

import numpy as np
import pycolmap
import pytest
from row_of_cameras import COUNT, error_of_centres, row_of_cameras

from fvs_engine.sfm.colmap.model import camera_poses
from fvs_engine.sfm.native.prior_adjustment import adjust_with_priors
from fvs_engine.sfm.native.robust_adjustment import RobustAdjustment
from fvs_engine.sfm.native.thresholds import ADJUSTMENT
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors

LENS = pycolmap.Camera(
    model="RADIAL", width=800, height=600, params=np.array([700.0, 392.0, 307.0, -0.06, 0.05]), camera_id=1
)
GUESS = pycolmap.Camera(
    model="SIMPLE_RADIAL", width=800, height=600, params=np.array([705.0, 400.0, 300.0, 0.0]), camera_id=1
)


def adjust(model: pycolmap.Reconstruction, *, refine: bool = True, lens: bool = True) -> None:
    RobustAdjustment(model, refine=refine, lens=lens, threads=1).solve()


def least_squares(model: pycolmap.Reconstruction) -> None:
    """Bundle adjustment by least squares, with fixed intrinsics."""
    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = options.refine_focal_length = options.refine_extra_params = False
    config = pycolmap.BundleAdjustmentConfig()
    for image_id in model.reg_image_ids():
        config.add_image(image_id)
    config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
    pycolmap.create_default_bundle_adjuster(options, config, model).solve()


def without_images_from(model: pycolmap.Reconstruction, number: int) -> pycolmap.Reconstruction:
    for image_id in range(number, COUNT + 1):
        model.deregister_frame(model.image(image_id).frame_id)
    return model


def test_wrong_matches_that_mappers_keep_hardly_move_cameras():
    clean = row_of_cameras(0.2, 6)
    squared, robust = (row_of_cameras(0.2, 6, wrong_share=0.05) for _ in range(2))
    least_squares(clean)
    least_squares(squared)
    adjust(robust, refine=False)
    assert error_of_centres(squared) > 2 * error_of_centres(clean)
    assert error_of_centres(robust) < 1.3 * error_of_centres(clean)


def test_principal_point_and_distortion_are_estimated_from_ten_images_on():
    plain, whole = (row_of_cameras(0.2, 8, taken_with=LENS, camera=GUESS) for _ in range(2))
    adjust(plain, lens=False)
    adjust(whole)
    assert plain.camera(1).model_name == "SIMPLE_RADIAL"
    assert plain.camera(1).params[1:3].tolist() == [400.0, 300.0]
    assert whole.camera(1).model_name == "RADIAL"
    assert error_of_centres(whole) < 0.5 * error_of_centres(plain)
    assert np.abs(whole.camera(1).params[1:3] - LENS.params[1:3]).max() < 3.0


@pytest.mark.parametrize(("images", "model"), [(9, "SIMPLE_RADIAL"), (10, "RADIAL")])
def test_a_camera_of_few_images_keeps_its_model(images: int, model: str):
    few = without_images_from(row_of_cameras(0.2, 6, taken_with=LENS, camera=GUESS), images + 1)
    adjust(few)
    assert few.camera(1).model_name == model


def test_a_lens_is_kept_when_most_of_its_images_are_gone():
    model = row_of_cameras(0.2, 8, taken_with=LENS, camera=GUESS)
    adjust(model)
    lens = model.camera(1).params.tolist()
    adjust(without_images_from(model, ADJUSTMENT.min_images_of_lens))
    assert (model.camera(1).model_name, model.camera(1).params.tolist()) == ("RADIAL", lens)


def test_the_principal_point_of_cropped_photographs_is_estimated():
    cropped = pycolmap.Camera(
        model="RADIAL", width=800, height=600, params=[700.0, 520.0, 300.0, -0.06, 0.05]
    )
    model = row_of_cameras(0.2, 8, taken_with=cropped, camera=GUESS)
    adjust(model)
    assert np.abs(model.camera(1).params[1:3] - cropped.params[1:3]).max() < 5.0


@pytest.mark.parametrize("with_priors", [False, True])
def test_a_camera_keeps_its_intrinsics_when_the_estimate_is_no_lens(with_priors: bool):
    """COLMAP's mapper would remove all images of such a camera."""
    taken_with = pycolmap.Camera(
        model="RADIAL", width=800, height=600, params=[700.0, 400.0, 300.0, 0.0, 2.5]
    )
    model, kept = (row_of_cameras(0.2, 8, taken_with=taken_with, camera=GUESS) for _ in range(2))
    adjustments = [
        RobustAdjustment(model, refine=True, lens=True, threads=1),
        RobustAdjustment(kept, refine=False, lens=False, threads=1),
    ]
    for adjustment in adjustments:
        if with_priors:
            by_name = {
                name: PosePrior(position=tuple(pose.translation), position_sigma=0.1)
                for name, pose in camera_poses(row_of_cameras(0.2, 8)).items()
            }
            assert adjust_with_priors(adjustment, PosePriors(by_name=by_name), 0)
        else:
            adjustment.solve()
    assert model.camera(1).model_name == "SIMPLE_RADIAL"
    assert model.camera(1).params.tolist() == GUESS.params.tolist()
    assert error_of_centres(model) == pytest.approx(error_of_centres(kept), rel=0.05)


def test_parallel_views_do_not_determine_a_lens():
    """Those of a drone that photographs flat ground: lens, heights and depths trade with each other."""
    model = row_of_cameras(0.2, 8, taken_with=LENS, camera=GUESS)
    for frame in model.frames.values():
        pose = frame.rig_from_world
        centre = pose.inverse().translation
        frame.rig_from_world = pycolmap.Rigid3d(pycolmap.Rotation3d(), -centre)
    adjust(model)
    assert model.camera(1).model_name == "SIMPLE_RADIAL"
    assert model.camera(1).params[1:3].tolist() == [400.0, 300.0]


def test_known_intrinsics_do_not_change():
    model = row_of_cameras(0.2, 8, taken_with=LENS, camera=GUESS)
    adjust(model, refine=False)
    assert model.camera(1).model_name == "SIMPLE_RADIAL"
    assert model.camera(1).params.tolist() == GUESS.params.tolist()


def test_another_camera_of_few_images_keeps_its_intrinsics():
    model = row_of_cameras(0.2, 6, taken_with=LENS, camera=GUESS, of_another_camera=4)
    adjust(model)
    assert (model.camera(1).model_name, model.camera(2).model_name) == ("RADIAL", "SIMPLE_RADIAL")
    assert model.camera(2).params.tolist() == GUESS.params.tolist()


def test_a_model_without_points_is_adjusted():
    model = row_of_cameras(0.2, 6)
    for point_id in list(model.point3D_ids()):
        model.delete_point3D(point_id)
    adjust(model)
    assert model.num_reg_images() == COUNT
