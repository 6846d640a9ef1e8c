"""Poses in a wrong minimum are found and replaced; right ones stay."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from model_databases import write_database
from row_of_cameras import PINHOLE, STEP, error_of_centres, row_of_cameras, true_poses

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.colmap.model import camera_poses, rigid_to_pycolmap
from fvs_engine.sfm.native.match_cache import load_all
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.native.pose_review import hangs_on_few_points, review_poses
from fvs_engine.sfm.native.prior_pose import ExpectedPose
from fvs_engine.sfm.native.registration import _Growth, _pipeline_options
from fvs_engine.sfm.pose_priors import PosePriors

MISLED, SEEN_BY = 12, 6
NAME = f"{MISLED - 1:02}.jpg"


def misled_model(wrong_share: float, apart: float = 0.3 * STEP) -> pycolmap.Reconstruction:
    """A model in which one image has a wrong pose, ``apart`` from the true one.

    ``wrong_share`` of its features are where that pose sees the points, as those of a repeated pattern are.
    """
    model = row_of_cameras(0.2, SEEN_BY)
    true = true_poses()[NAME]
    wrong = RigidTransform(true.rotation, true.translation - true.rotation @ np.array([apart, 0.0, 0.0]))
    image = model.image(MISLED)
    random = np.random.default_rng(3)
    for k, point in enumerate(image.points2D):
        if int((k + 1) * wrong_share) > int(k * wrong_share):
            xyz = np.asarray(model.point3D(point.point3D_id).xyz)
            seen = np.asarray(PINHOLE.img_from_cam(wrong.apply(xyz[None])))[0]
            point.xy = seen + random.normal(0.0, 0.2, 2)
    model.frame(image.frame_id).rig_from_world = rigid_to_pycolmap(wrong)
    return model


def review(
    model: pycolmap.Reconstruction, folder: Path, expected: dict[str, ExpectedPose] | None = None
) -> list[str]:
    write_database(model, folder / "database.db")
    observations = pycolmap.ObservationManager(model)
    every = model.reg_image_ids()
    return review_poses(model, observations, folder / "database.db", every, expected or {}, 0)


def error_of(model: pycolmap.Reconstruction) -> float:
    return float(
        np.linalg.norm(camera_poses(model)[NAME].translation - true_poses()[NAME].inverse().translation)
    )


def test_a_pose_that_a_part_of_the_matches_fits_is_replaced(tmp_path: Path):
    model = misled_model(0.4)
    assert error_of(model) > 0.25
    assert review(model, tmp_path) == [NAME]
    assert error_of(model) < 0.02
    seen = [point for point in model.image(MISLED).points2D if point.has_point3D()]
    assert 0.5 * SEEN_BY * 12 < len(seen) < 0.7 * SEEN_BY * 12  # those that fit the new pose


def test_a_right_pose_stays_and_so_does_one_that_most_matches_fit(tmp_path: Path):
    right = row_of_cameras(0.2, SEEN_BY)
    (tmp_path / "right").mkdir()
    before = camera_poses(right)
    assert review(right, tmp_path / "right") == []
    assert all(np.array_equal(before[name].matrix, pose.matrix) for name, pose in camera_poses(right).items())
    assert review(misled_model(0.7), tmp_path) == []


def test_a_pose_stays_that_explains_more_of_what_only_two_images_show(tmp_path: Path):
    """Verified matches without a point, as two images have, are evidence as well."""
    model = misled_model(0.7)
    path = tmp_path / "database.db"
    write_database(model, path)
    seen_at = camera_poses(model)[NAME].inverse()
    fitting = []
    for point in model.image(MISLED).points2D:
        pixel = PINHOLE.img_from_cam(seen_at.apply(np.asarray(model.point3D(point.point3D_id).xyz)[None]))
        if np.linalg.norm(pixel[0] - point.xy) < 2.0:
            fitting.append(point.point3D_id)
    for point_id in fitting[10:]:
        model.delete_point3D(point_id)
    every = model.reg_image_ids()
    assert review_poses(model, pycolmap.ObservationManager(model), path, every, {}, 0) == []


@pytest.mark.parametrize(("expected_at", "changed"), [("right", [NAME]), ("wrong", [])])
def test_a_prior_decides_between_poses_that_matches_fit_equally(
    expected_at: str, changed: list[str], tmp_path: Path
):
    model = misled_model(0.5)
    place = true_poses()[NAME] if expected_at == "right" else camera_poses(model)[NAME].inverse()
    assert review(model, tmp_path, {NAME: ExpectedPose(place, 1e-3, 1e-4)}) == changed


def test_global_bundle_adjustment_begins_with_a_review(tmp_path: Path):
    model = misled_model(0.4)
    path = tmp_path / "database.db"
    write_database(model, path)
    names = [image.name for image in model.images.values()]
    growth = _Growth(
        model,
        load_all(path, names, model),
        _pipeline_options(refine=False, seed=0, threads=1, two_view_points=False),
        PoseCheck((), {}, 0.75, PosePriors()),
        database=path,
        names=names,
        lens=False,
    )
    growth.adjust_all()
    growth.mapper.end_reconstruction(False)
    assert error_of(model) < 0.03
    assert error_of_centres(model) < 0.005


@pytest.mark.parametrize(("seen_by", "few"), [(2, True), (3, False)])
def test_only_points_that_two_other_images_see_hold_an_image(
    seen_by: int, few: bool, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("row_of_cameras.EACH", 150)
    model = row_of_cameras(0.2, seen_by)
    assert model.image(MISLED).num_points3D == 150 * seen_by
    assert hangs_on_few_points(model, model.image(MISLED)) == few
