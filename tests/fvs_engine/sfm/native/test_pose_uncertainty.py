"""Images whose position their matches do not determine stay unregistered."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from model_databases import write_database
from row_of_cameras import PINHOLE, row_of_cameras, true_poses
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.native.match_cache import load_all
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.native.pose_uncertainty import MAX_SHARE, uncertain_share
from fvs_engine.sfm.native.prior_pose import ExpectedPose, centre_sigma, refine
from fvs_engine.sfm.native.registration import _Growth, _pipeline_options
from fvs_engine.sfm.pose_priors import PosePriors

IMAGE, SEEN_BY = 12, 6
NAME = f"{IMAGE - 1:02}.jpg"


def row_with_a_far_view() -> pycolmap.Reconstruction:
    """A row of cameras with true poses; all points of one image are far away and close together."""
    model, random = row_of_cameras(0.2, SEEN_BY), np.random.default_rng(1)
    poses = true_poses()
    for seen in model.image(IMAGE).points2D:
        point = model.point3D(seen.point3D_id)
        point.xyz = random.uniform([8.0, -3.0, 50.0], [14.0, 3.0, 55.0])
        for element in point.track.elements:
            image = model.image(element.image_id)
            pixel = np.asarray(PINHOLE.img_from_cam(poses[image.name].apply(point.xyz[None])))[0]
            image.points2D[element.point2D_idx].xy = pixel + random.normal(0.0, 0.5, 2)
    return model


@pytest.mark.parametrize("with_prior", [False, True])
def test_the_standard_deviation_is_that_of_repeated_estimates(with_prior: bool):
    random, true = np.random.default_rng(0), true_poses()[NAME]
    place = true.inverse()
    points = place.apply(random.uniform([-1.0, -1.0, 20.0], [1.0, 1.0, 22.0], (60, 3)))
    exact = np.asarray(PINHOLE.img_from_cam(true.apply(points)))

    def expected() -> ExpectedPose | None:
        if not with_prior:
            return None
        turn = Rotation.from_rotvec(random.normal(0.0, np.radians(1.0), 3)).as_matrix()
        noisy = RigidTransform(place.rotation @ turn, place.translation + random.normal(0.0, 0.02, 3))
        return ExpectedPose(noisy.inverse(), 0.02, np.radians(1.0))

    shifts = []
    for _ in range(300):
        pose = refine(true, points, exact + random.normal(0.0, 0.5, exact.shape), PINHOLE, 0.5, expected())
        shifts.append(pose.inverse().translation - place.translation)
    scatter = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(shifts).T))[-1])
    sigma = centre_sigma(true, points, exact, PINHOLE, 0.5, expected())
    assert 0.8 < scatter / sigma < 1.25
    assert (sigma < 0.025) == with_prior


def test_far_points_close_together_leave_a_position_uncertain():
    model = row_with_a_far_view()
    share = uncertain_share(model, model.image(IMAGE), None)
    assert share is not None
    assert share > MAX_SHARE
    assert all(uncertain_share(model, model.image(other), None) is None for other in (1, 2, 23, 24))


def test_an_accurate_prior_makes_a_position_certain():
    model = row_with_a_far_view()
    expected = ExpectedPose(true_poses()[NAME], 0.01, np.radians(1.0))
    assert uncertain_share(model, model.image(IMAGE), expected) is None


@pytest.mark.parametrize("far", [True, False])
def test_growth_rejects_new_images_with_uncertain_positions(far: bool, tmp_path: Path):
    model = row_with_a_far_view() if far else row_of_cameras(0.2, SEEN_BY)
    path = tmp_path / "database.db"
    write_database(model, path)
    names = [image.name for image in model.images.values()]
    growth = _Growth(
        model,
        load_all(path, names, model),
        _pipeline_options(refine=False, seed=0, threads=1, two_view_points=False),
        PoseCheck.read(str(path), 0.75, PosePriors()),
        database=path,
        names=names,
        lens=False,
    )
    growth.registered.append(NAME)
    growth.mapper.end_reconstruction(False)
    growth.check_new()
    assert model.image(IMAGE).has_pose == (not far)
    assert list(growth.rejected) == ([NAME] if far else [])
    assert all("position uncertain by" in reason for reason in growth.rejected.values())
