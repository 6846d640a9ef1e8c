"""Images whose position their matches do not determine stay unregistered."""

import re
from pathlib import Path

import numpy as np
import pycolmap
import pytest
from model_databases import write_database
from row_of_cameras import PINHOLE, row_of_cameras, true_poses

from fvs_engine.sfm.native.match_cache import load_all
from fvs_engine.sfm.native.pose_check import PoseCheck
from fvs_engine.sfm.native.pose_uncertainty import MAX_SHARE, centre_sigma, why_uncertain
from fvs_engine.sfm.native.prior_pose import refine
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


@pytest.mark.parametrize("shared", [False, True])
def test_the_standard_deviation_is_that_of_repeated_estimates(shared: bool):
    """Also where the points in one part of the image are off together (``shared``)."""
    random, true = np.random.default_rng(0), true_poses()[NAME]
    place = true.inverse()
    points = place.apply(random.uniform([-4.0, -3.0, 9.0], [4.0, 3.0, 11.0], (80, 3)))
    exact = np.asarray(PINHOLE.img_from_cam(true.apply(points)))
    _, part = np.unique(exact // (800 / 6, 600 / 4) @ (4, 1), return_inverse=True)
    shifts, sigmas = [], []
    for _ in range(150):
        errors = random.normal(0.0, 0.5, exact.shape)
        pixels = exact + (errors[part] if shared else errors)
        pose = refine(true, points, pixels, PINHOLE, 0.5, None)
        shifts.append(pose.inverse().translation - place.translation)
        sigmas.append(centre_sigma(true, points, pixels, PINHOLE))
    scatter = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(shifts).T))[-1])
    assert 0.7 < np.median(sigmas) / scatter < 1.5


def test_nothing_is_certain_when_one_part_of_the_image_has_all_points():
    true, random = true_poses()[NAME], np.random.default_rng(0)
    points = true.inverse().apply(random.uniform([0.1, 0.1, 9.0], [0.9, 0.9, 11.0], (40, 3)))
    pixels = np.asarray(PINHOLE.img_from_cam(true.apply(points)))
    assert centre_sigma(true, points, pixels, PINHOLE) == np.inf


def test_far_points_close_together_leave_a_position_uncertain():
    model = row_with_a_far_view()
    reason = why_uncertain(model, model.image(IMAGE))
    assert reason is not None
    found = re.search(r"uncertain by (\d+)% of the spread", reason)
    assert found
    assert int(found[1]) >= 100 * MAX_SHARE
    assert all(why_uncertain(model, model.image(other)) is None for other in (1, 2, 23, 24))


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
    assert all("position uncertain" in reason for reason in growth.rejected.values())
