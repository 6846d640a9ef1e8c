"""Matches of an image with known points, guided by its expected pose."""

from dataclasses import replace

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.native.guided_matching import GuidedPose, guided_pose
from fvs_engine.sfm.native.known_points import Features, KnownPoints
from fvs_engine.sfm.native.prior_pose import ExpectedPose, PoseProblem
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.verification.prior_frame import believed_frame

CAMERA = pycolmap.Camera(
    model="SIMPLE_PINHOLE", width=800, height=600, params=np.array([700.0, 400.0, 300.0])
)
POINTS = 400
TRUE = RigidTransform(Rotation.from_rotvec([0.05, -0.1, 0.02]).as_matrix(), np.array([0.2, -0.1, 0.3]))
POSITION_SIGMA, ORIENTATION_SIGMA = 0.05, np.radians(4.0)


def moved(pose: RigidTransform, shift: np.ndarray, turn: np.ndarray) -> RigidTransform:
    rotation = Rotation.from_rotvec(turn).as_matrix() @ pose.rotation
    return RigidTransform(rotation, -rotation @ (pose.inverse().translation + shift))


def expected(shift: tuple[float, ...] = (0.05, -0.04, 0.03), turn: tuple[float, ...] = (0.08, -0.05, 0.06)):
    return ExpectedPose(moved(TRUE, np.array(shift), np.array(turn)), POSITION_SIGMA, ORIENTATION_SIGMA)


def centre_error(pose: RigidTransform) -> float:
    return float(np.linalg.norm(pose.inverse().translation - TRUE.inverse().translation))


@pytest.fixture(scope="module")
def known() -> KnownPoints:
    """Points in front of the camera, each seen once, from the origin."""
    random = np.random.default_rng(0)
    xyz = random.uniform([-4.0, -3.0, 5.0], [4.0, 3.0, 12.0], (POINTS, 3))
    descriptors = random.exponential(size=(POINTS, 128)).astype(np.float32)
    turns = random.uniform(0.0, 2.0 * np.pi, POINTS)
    axes = np.stack([np.cos(turns), np.sin(turns), np.zeros(POINTS)], axis=1) * xyz[:, 2:] * 3.0 / 700.0
    numbers = np.arange(POINTS)
    return KnownPoints(
        xyz,
        numbers,
        np.ones(POINTS, dtype=np.int64),
        numbers,
        descriptors / np.linalg.norm(descriptors, axis=1, keepdims=True),
        axes,
        xyz / np.linalg.norm(xyz, axis=1, keepdims=True),
    )


@pytest.fixture(scope="module")
def features(known: KnownPoints) -> Features:
    """What a camera at TRUE sees of them, in the order of the points, and as many look-alikes elsewhere."""
    random = np.random.default_rng(1)
    local = TRUE.apply(known.xyz)
    pixels = np.asarray(CAMERA.img_from_cam(local)) + random.normal(size=(POINTS, 2))
    ahead = TRUE.apply(known.xyz + known.axes)
    axes = np.asarray(CAMERA.img_from_cam(ahead)) - np.asarray(CAMERA.img_from_cam(local))
    elsewhere = random.uniform([0.0, 0.0], [800.0, 600.0], (POINTS, 2))
    noisy = known.descriptors + random.normal(0.0, 0.01, known.descriptors.shape).astype(np.float32)
    alike = known.descriptors + random.normal(0.0, 0.01, known.descriptors.shape).astype(np.float32)
    descriptors = np.concatenate([noisy, alike])
    descriptors /= np.linalg.norm(descriptors, axis=1, keepdims=True)
    return Features(np.concatenate([pixels, elsewhere]), np.concatenate([axes, axes]), descriptors)


def found(
    known: KnownPoints, features: Features, prior: ExpectedPose, camera: pycolmap.Camera = CAMERA
) -> GuidedPose:
    guided = guided_pose(known, features, camera, prior)
    assert guided is not None
    return guided


def test_windows_tell_points_from_their_look_alikes(known: KnownPoints, features: Features):
    """The ratio test over the whole image passes no feature: every one has a look-alike."""
    guided = found(known, features, expected())
    assert guided.believed
    right = guided.features == guided.points
    assert right.sum() > 100
    assert right.mean() > 0.95
    assert centre_error(guided.camera_from_model) < 0.2 * centre_error(expected().camera_from_model)


def test_features_of_another_place_are_not_believed(known: KnownPoints, features: Features):
    shuffled = replace(features, descriptors=features.descriptors[np.random.default_rng(2).permutation(800)])
    guided = guided_pose(known, shuffled, CAMERA, expected())
    assert guided is None or not guided.believed


def test_many_matches_far_from_the_expected_pose_are_not_believed(known: KnownPoints, features: Features):
    """As of a look-alike place: the windows are wide, because the orientation is hardly known."""
    off = replace(expected((0.5, 0.0, 0.0), (0.0, 0.0, 0.0)), orientation_sigma=np.radians(8.0))
    guided = found(known, features, off)
    assert len(guided.points) > 100
    assert guided.sigmas > 4.5
    assert not guided.believed


def test_features_turned_or_scaled_otherwise_do_not_match(known: KnownPoints, features: Features):
    turned = replace(features, axes=features.axes @ np.array([[0.0, 1.0], [-1.0, 0.0]]))
    scaled = replace(features, axes=4.0 * features.axes)
    for changed in (turned, scaled):
        guided = guided_pose(known, changed, CAMERA, expected())
        assert guided is None or not guided.believed


def test_features_that_the_distortion_gives_no_ray_do_not_match(known: KnownPoints, features: Features):
    """At a strong distortion the corners of the image are beyond the reach of its polynomial."""
    camera = pycolmap.Camera(
        model="SIMPLE_RADIAL", width=800, height=600, params=np.array([700.0, 400.0, 300.0, -0.5])
    )
    pixels = np.asarray(camera.img_from_cam(TRUE.apply(known.xyz)))
    outward = pixels - [400.0, 300.0]
    length = np.linalg.norm(outward, axis=1, keepdims=True)
    pixels += np.where(length > 350.0, 20.0 * outward / length, 0.0)
    assert np.isnan(np.asarray(camera.cam_from_img(pixels))).any(axis=1).sum() > 10
    beyond = replace(features, pixels=np.concatenate([pixels, features.pixels[POINTS:]]))
    guided = found(known, beyond, expected(), camera)
    assert guided.believed
    assert centre_error(guided.camera_from_model) < 0.2 * centre_error(expected().camera_from_model)


def test_a_vague_prior_guides_nothing():
    """Its windows would be as large as the image."""
    random = np.random.default_rng(0)
    poses = {f"{k}": RigidTransform(np.eye(3), random.normal(0.0, 1.0, 3)) for k in range(12)}
    priors = PosePriors(by_name={name: PosePrior.of_camera(pose, 0.02, 5.0) for name, pose in poses.items()})
    frame = believed_frame(priors, poses)
    assert frame is not None
    for sigmas, guides in (((0.02, 5.0), True), ((1e9, 5.0), False), ((0.02, 90.0), False)):
        prior = PosePrior.of_camera(RigidTransform.identity(), *sigmas)
        assert (ExpectedPose.of(prior, priors, frame) is not None) is guides


def test_one_position_at_the_end_of_the_world_does_not_widen_the_windows():
    """Of a receiver without a fix, at one of the first images, which no other position contradicts yet."""
    random = np.random.default_rng(0)
    poses = {f"{k}": RigidTransform(np.eye(3), random.normal(0.0, 1.0, 3)) for k in range(12)}
    by_name = {name: PosePrior.of_camera(pose, 0.02, 5.0) for name, pose in poses.items()}
    far = by_name | {"0": PosePrior.of_camera(RigidTransform(np.eye(3), np.full(3, 1e5)), 0.02, 5.0)}
    new = PosePrior.of_camera(RigidTransform.identity(), 0.02, 5.0)
    sigmas = []
    for each in (by_name, far):
        priors = PosePriors(by_name=each)
        frame = believed_frame(priors, poses)
        assert frame is not None
        pose = ExpectedPose.of(new, priors, frame)
        assert pose is not None
        sigmas.append(pose.position_sigma)
    assert sigmas[1] < 1.2 * sigmas[0]


@pytest.mark.parametrize(("count", "gain"), [(4, 0.8), (200, 1.02)])
def test_a_prior_helps_where_points_are_few_and_does_not_hurt_where_they_are_many(count: int, gain: float):
    random = np.random.default_rng(3)
    errors: dict[bool, list[float]] = {True: [], False: []}
    for _ in range(40):
        # Points in the middle of the image tell turns from shifts badly.
        points = random.uniform([-0.7, -0.7, 7.0], [0.7, 0.7, 8.0], (count, 3))
        pixels = np.asarray(CAMERA.img_from_cam(TRUE.apply(points))) + random.normal(0.0, 1.0, (count, 2))
        shift, turn = random.normal(0.0, POSITION_SIGMA, 3), random.normal(0.0, ORIENTATION_SIGMA, 3)
        prior = ExpectedPose(moved(TRUE, shift, turn), POSITION_SIGMA, ORIENTATION_SIGMA)
        for used in (True, False):
            pose = PoseProblem(points, pixels, CAMERA, 1.0, prior if used else None).refine(TRUE)
            errors[used].append(centre_error(pose))
    assert np.median(errors[True]) <= gain * np.median(errors[False])


def test_a_wrong_prior_hardly_moves_a_pose_that_points_fix(known: KnownPoints, features: Features):
    pixels = features.pixels[:POINTS]
    wrong = expected((3.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    start = expected().camera_from_model
    alone, pulled = (
        PoseProblem(known.xyz, pixels, CAMERA, 1.0, prior).refine(start) for prior in (None, wrong)
    )
    assert centre_error(alone) < 0.01
    assert centre_error(pulled) < 0.02
