"""Images whose position their matches do not determine stay unregistered."""

from pathlib import Path

import numpy as np
import pycolmap
import pytest
from growths import growth_of, registration_request
from model_databases import write_database
from row_of_cameras import PINHOLE, row_of_cameras, true_poses

from fvs_engine.sfm.colmap.model import rigid_to_pycolmap
from fvs_engine.sfm.native.points_of_others import Rays
from fvs_engine.sfm.native.pose_uncertainty import centre_sigma, position_share, why_uncertain
from fvs_engine.sfm.native.prior_pose import PoseProblem
from fvs_engine.sfm.native.registration import register
from fvs_engine.sfm.native.thresholds import POSES
from fvs_schema.findings import Finding, FindingCode

IMAGE, SEEN_BY = 12, 6
NAME = f"{IMAGE - 1:02}.jpg"


def row_with_far_views(*image_ids: int) -> pycolmap.Reconstruction:
    """A row of cameras with true poses; all points of the given images are far away and close together."""
    model, random = row_of_cameras(0.2, SEEN_BY), np.random.default_rng(1)
    poses = true_poses()
    far = {seen.point3D_id for image_id in image_ids for seen in model.image(image_id).points2D}
    for point_id in sorted(far):
        point = model.point3D(point_id)
        point.xyz = random.uniform([8.0, -3.0, 50.0], [14.0, 3.0, 55.0])
        for element in point.track.elements:
            image = model.image(element.image_id)
            pixel = np.asarray(PINHOLE.img_from_cam(poses[image.name].apply(point.xyz[None])))[0]
            image.points2D[element.point2D_idx].xy = pixel + random.normal(0.0, 0.5, 2)
    return model


def share_of(model: pycolmap.Reconstruction, image_id: int) -> float | None:
    return position_share(model, model.image(image_id), Rays(model))


def check_new(model: pycolmap.Reconstruction, folder: Path, new: list[int]) -> dict[str, str]:
    """Check images as if they were just registered; returns the rejected ones with the reasons."""
    growth = growth_of(model, folder, [model.image(image_id).name for image_id in new])
    growth.mapper.end_reconstruction(False)
    growth.check_new()
    return growth.rejected


@pytest.mark.parametrize("shared", [False, True])
def test_the_standard_deviation_is_that_of_repeated_estimates(shared: bool):
    """Also when all points in a cell of the image have the same error (``shared``)."""
    random, true = np.random.default_rng(0), true_poses()[NAME]
    place = true.inverse()
    points = place.apply(random.uniform([-4.0, -3.0, 9.0], [4.0, 3.0, 11.0], (80, 3)))
    exact = np.asarray(PINHOLE.img_from_cam(true.apply(points)))
    _, part = np.unique(exact // (800 / 6, 600 / 4) @ (4, 1), return_inverse=True)
    shifts, sigmas = [], []
    for _ in range(50):
        errors = random.normal(0.0, 0.5, exact.shape)
        pixels = exact + (errors[part] if shared else errors)
        pose = PoseProblem(points, pixels, PINHOLE, 0.5).refine(true)
        shifts.append(pose.inverse().translation - place.translation)
        if len(sigmas) < 10:
            sigmas.append(centre_sigma(true, points, pixels, PINHOLE))
    scatter = np.sqrt(np.linalg.eigvalsh(np.cov(np.array(shifts).T))[-1])
    assert 0.7 < np.median(sigmas) / scatter < 1.5


def test_nothing_is_certain_when_one_part_of_the_image_has_all_points():
    true, random = true_poses()[NAME], np.random.default_rng(0)
    points = true.inverse().apply(random.uniform([0.1, 0.1, 9.0], [0.9, 0.9, 11.0], (40, 3)))
    pixels = np.asarray(PINHOLE.img_from_cam(true.apply(points)))
    assert centre_sigma(true, points, pixels, PINHOLE) == np.inf


def test_far_points_close_together_leave_a_position_uncertain():
    model = row_with_far_views(IMAGE)
    share = share_of(model, IMAGE)
    assert share is not None
    assert share > POSES.max_position_share
    assert why_uncertain(NAME, share) == Finding.of(FindingCode.POSE_UNCERTAIN, [NAME], share=share)
    certain = [share_of(model, other) for other in (1, 2, 23, 24)]
    assert all(other is not None and other < POSES.max_position_share for other in certain)
    model.transform(pycolmap.Sim3d(3.0, pycolmap.Rotation3d(), np.zeros(3)))
    assert share_of(model, IMAGE) == pytest.approx(share, rel=0.05)


def test_an_image_of_which_too_little_is_known_is_not_judged():
    model = row_with_far_views(IMAGE)
    seen = [feature for feature, point in enumerate(model.image(IMAGE).points2D) if point.has_point3D()]
    observations = pycolmap.ObservationManager(model)
    for feature in seen[12:]:
        observations.delete_observation(IMAGE, feature)
    assert share_of(model, IMAGE) is not None
    for feature in seen[9:12]:
        observations.delete_observation(IMAGE, feature)
    assert share_of(model, IMAGE) is None
    few_cameras = row_with_far_views(IMAGE)
    for image_id in set(few_cameras.reg_image_ids()) - {IMAGE - 1, IMAGE, IMAGE + 1, IMAGE + 2}:
        few_cameras.deregister_frame(few_cameras.image(image_id).frame_id)
    assert share_of(few_cameras, IMAGE) is None


def test_its_own_observations_do_not_vouch_for_an_image():
    """Points that follow a wrong pose fit it; those of the other images do not."""
    model = row_with_far_views(IMAGE)
    before = share_of(model, IMAGE)
    ahead = true_poses()[NAME].inverse().apply(np.array([[0.0, 0.0, 5.0]]))[0]
    for seen in model.image(IMAGE).points2D:
        model.point3D(seen.point3D_id).xyz = ahead
    assert share_of(model, IMAGE) == before


def test_pixels_where_a_lens_distorts_too_much_do_not_count():
    model = row_with_far_views(IMAGE)
    camera = model.camera(1)
    camera.model, camera.params = pycolmap.CameraModelId.SIMPLE_RADIAL, [700.0, 400.0, 300.0, -0.9]
    model.image(IMAGE).points2D[0].xy = np.array([799.0, 599.0])
    assert not np.isfinite(camera.cam_from_img(np.array([[799.0, 599.0]]))).all()
    share = share_of(model, IMAGE)
    assert share is not None
    assert np.isfinite(share)


@pytest.mark.parametrize("far", [True, False])
def test_growth_rejects_new_images_with_uncertain_positions(far: bool, tmp_path: Path):
    model = row_with_far_views(IMAGE) if far else row_of_cameras(0.2, SEEN_BY)
    rejected = check_new(model, tmp_path, [IMAGE])
    assert model.image(IMAGE).has_pose == (not far)
    assert list(rejected) == ([NAME] if far else [])
    assert all(reason.code is FindingCode.POSE_UNCERTAIN for reason in rejected.values())


@pytest.mark.parametrize("order", [[12, 13, 14], [14, 13, 12]])
def test_the_order_of_new_images_does_not_matter(order: list[int], tmp_path: Path):
    model = row_with_far_views(12, 13, 14)
    rejected = check_new(model, tmp_path, order)
    assert sorted(rejected) == ["11.jpg", "12.jpg", "13.jpg"]


def test_a_certain_image_stays_beside_an_uncertain_one(tmp_path: Path):
    rejected = check_new(row_with_far_views(IMAGE), tmp_path, [4, IMAGE, 20])
    assert list(rejected) == [NAME]


def test_an_image_that_a_rejection_leaves_with_too_few_points_is_rejected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    model = row_of_cameras(0.2, SEEN_BY)

    def share(_: pycolmap.Reconstruction, image: pycolmap.Image, __: Rays) -> float | None:
        if image.image_id == IMAGE:
            return 0.05
        return 0.01 if model.image(IMAGE).has_pose else None

    monkeypatch.setattr("fvs_engine.sfm.native.registration.position_share", share)
    rejected = check_new(model, tmp_path, [IMAGE + 1, IMAGE])
    assert list(rejected) == [NAME, f"{IMAGE:02}.jpg"]
    left = f"{IMAGE:02}.jpg"
    assert rejected[left] == Finding.of(FindingCode.POSE_UNDETERMINED, [left])


def test_a_contradicted_image_is_named_with_what_contradicts_it(tmp_path: Path):
    model = row_with_far_views(IMAGE)
    growth = growth_of(model, tmp_path, [NAME])
    growth.mapper.end_reconstruction(False)
    model.frame(model.image(IMAGE).frame_id).rig_from_world = rigid_to_pycolmap(true_poses()["00.jpg"])
    growth.check_new()
    assert growth.rejected[NAME].code is FindingCode.POSE_UNSUPPORTED


def test_the_job_rejects_an_uncertain_image(tmp_path: Path):
    model = row_with_far_views(IMAGE)
    write_database(model, tmp_path / "database.db")
    model.deregister_frame(model.image(IMAGE).frame_id)
    for folder in ("model", "out"):
        (tmp_path / folder).mkdir()
    model.write_binary(tmp_path / "model")
    answer = register(
        registration_request(
            tmp_path,
            [NAME],
            adjust_every=0.5,
            adjusted_images=23,
            adjusted_points=model.num_points3D(),
        ),
        lambda _: None,
    )
    assert answer.registered == ()
    assert answer.rejected[NAME].code is FindingCode.POSE_UNCERTAIN
    assert NAME not in answer.posed
