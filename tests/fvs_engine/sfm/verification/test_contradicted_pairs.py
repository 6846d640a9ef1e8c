from collections.abc import Mapping

import numpy as np
import pycolmap
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform, SimilarityTransform, look_at
from fvs_engine.sfm.colmap.database import VerifiedPair
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.verification.contradicted_pairs import KnownCameras, contradicted_pairs
from fvs_engine.sfm.verification.prior_frame import PriorFrame, believed_frame, orientations_contradict

CAMERA = pycolmap.Camera(
    model="SIMPLE_PINHOLE", width=640, height=480, params=np.array([500.0, 320.0, 240.0]), camera_id=1
)
WORLD_FROM_MODEL = SimilarityTransform(
    3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
)
REGISTERED = [f"{k:02}" for k in range(10)]
NEW = "10"
SPREAD = 3.0 * 4.0  # of the cameras in the world, about

Poses = Mapping[str, RigidTransform]


def orbit(count: int) -> dict[str, RigidTransform]:
    """Cameras 4 from the middle, 10° from each to the next: model_from_camera."""
    angles = np.deg2rad(10.0 * np.arange(count))
    places = np.stack([4 * np.cos(angles), 4 * np.sin(angles), 0.5 * np.sin(3 * angles)], axis=1)
    return {
        f"{k:02}": look_at(place, np.zeros(3), np.array([0.0, 0.0, 1.0])) for k, place in enumerate(places)
    }


def priors_of(poses: Poses, sigma: float = 0.0, sigma_deg: float = 0.0, seed: int = 0) -> PosePriors:
    random = np.random.default_rng(seed)
    by_name = {}
    for name, pose in poses.items():
        world = WORLD_FROM_MODEL.move_camera(pose)
        turn = Rotation.from_rotvec(np.deg2rad(sigma_deg) * random.normal(size=3)).as_matrix()
        noisy = RigidTransform(turn @ world.rotation, world.translation + sigma * random.normal(size=3))
        by_name[name] = PosePrior.of_camera(noisy, sigma, sigma_deg)
    return PosePriors(by_name=by_name)


def matched(first: RigidTransform, second: RigidTransform) -> tuple[VerifiedPair, dict[int, np.ndarray]]:
    """What two cameras see of the same points: a pair of the images 1 and 2, and its keypoints."""
    points = np.random.default_rng(1).uniform(-1.0, 1.0, size=(200, 3))
    keypoints = {
        number: np.asarray(CAMERA.img_from_cam(pose.inverse().apply(points)))
        for number, pose in ((1, first), (2, second))
    }
    return VerifiedPair(1, 2, np.repeat(np.arange(200, dtype=np.uint32)[:, None], 2, axis=1)), keypoints


def vetoed(
    names: tuple[str, str],
    seen_from: tuple[RigidTransform, RigidTransform],
    registered: Poses,
    priors: PosePriors,
    cameras: Mapping[int, pycolmap.Camera] | None = None,
) -> bool:
    frame = believed_frame(priors, registered)
    assert frame is not None
    pair, keypoints = matched(*seen_from)
    both = {1: CAMERA, 2: CAMERA} if cameras is None else cameras
    known = KnownCameras({1: names[0], 2: names[1]}, both, registered)
    return bool(contradicted_pairs([pair], keypoints, known, priors, frame))


@pytest.fixture
def poses() -> dict[str, RigidTransform]:
    return orbit(14)


@pytest.fixture
def registered(poses: Poses) -> dict[str, RigidTransform]:
    return {name: poses[name] for name in REGISTERED}


@pytest.mark.parametrize("order", [1, -1])
def test_right_pairs_pass_and_look_alike_ones_do_not(poses: Poses, registered: Poses, order: int):
    """The new image matches as if it were on the other side of a registered one."""
    priors = priors_of(poses, 0.02 * SPREAD, 5.0)
    for name, elsewhere in (("04", "00"), ("07", "03"), ("05", "01")):
        names, right = (name, NEW)[::order], (poses[name], poses[NEW])[::order]
        assert not vetoed(names, right, registered, priors)
        assert vetoed(names, (poses[name], poses[elsewhere])[::order], registered, priors)


def test_the_noise_of_positions_widens_the_limit(poses: Poses, registered: Poses):
    """Between neighbours it turns the baseline by 14° about each axis, more than 15° in every second case."""
    near = (poses["09"], poses["10"])
    noisy = [priors_of(poses, 0.03 * SPREAD, seed=seed) for seed in range(20)]
    assert sum(vetoed(("09", NEW), near, registered, priors) for priors in noisy) <= 2
    exact = {
        name: prior.model_copy(update={"position_sigma": 0.0}) for name, prior in noisy[0].by_name.items()
    }
    assert vetoed(("09", NEW), (poses["09"], poses["08"]), registered, PosePriors(by_name=exact))


def test_priors_are_no_more_accurate_than_those_of_registered_images(poses: Poses, registered: Poses):
    """They claim to be exact, as those without a standard deviation do."""
    near = (poses["10"], poses["11"])
    noisy = [priors_of(poses, 0.03 * SPREAD, 5.0, seed) for seed in range(20)]
    exact = [
        PosePriors(
            by_name={
                name: prior.model_copy(update={"position_sigma": 0.0, "orientation_sigma_deg": 0.0})
                for name, prior in priors.by_name.items()
            }
        )
        for priors in noisy
    ]
    assert sum(vetoed(("10", "11"), near, registered, priors) for priors in exact) <= 2
    frame = believed_frame(exact[0], registered)
    assert frame is not None
    assert 0.01 * SPREAD < frame.position_noise < 0.05 * SPREAD
    assert 2.0 < frame.orientation_noise_deg < 8.0


def test_directions_by_a_guessed_focal_length_are_not_believed(poses: Poses, registered: Poses):
    elsewhere, priors = (poses["05"], poses["01"]), priors_of(poses)
    assert vetoed(("05", NEW), elsewhere, registered, priors)
    assert not vetoed(("05", NEW), elsewhere, registered, priors, {1: CAMERA})


def test_two_registered_images_are_left_to_the_gate(poses: Poses, registered: Poses):
    assert not vetoed(("04", "08"), (poses["04"], poses["00"]), registered, priors_of(poses))


def test_orientations_judge_pairs_of_images_that_are_both_new(poses: Poses, registered: Poses):
    priors = priors_of(poses, 0.02, 2.0)
    right, wrong = (poses["10"], poses["13"]), (poses["13"], poses["10"])
    assert not vetoed(("10", "13"), right, registered, priors)
    assert vetoed(("10", "13"), wrong, registered, priors)
    flipped = PosePriors(by_name={name: _turned(prior) for name, prior in priors.by_name.items()})
    assert orientations_contradict(flipped, registered)
    assert not orientations_contradict(priors, registered)
    assert not vetoed(("10", "13"), right, registered, flipped)  # as without orientations
    assert not vetoed(("10", "13"), wrong, registered, flipped)
    positions = {
        name: PosePrior(position=prior.position, position_sigma=0.02)
        for name, prior in priors.by_name.items()
    }
    assert not vetoed(("10", "13"), wrong, registered, PosePriors(by_name=positions))


def _turned(prior: PosePrior) -> PosePrior:
    """The camera looks backwards."""
    assert prior.rotation is not None
    backwards = RigidTransform(prior.rotation @ np.diag([-1.0, 1.0, -1.0]), np.array(prior.position))
    return PosePrior.of_camera(backwards, prior.position_sigma, prior.orientation_sigma_deg)


def test_priors_that_contradict_the_model_are_not_believed(registered: Poses):
    honest = priors_of(registered, 0.01 * SPREAD)
    assert believed_frame(honest, registered) is not None
    shuffled = dict(zip(registered, np.random.default_rng(5).permutation(REGISTERED), strict=True))
    swapped = PosePriors(by_name={name: honest.by_name[other] for name, other in shuffled.items()})
    assert believed_frame(swapped, registered) is None
    frozen = PosePriors(by_name=dict.fromkeys(registered, honest.by_name["00"]))
    assert believed_frame(frozen, registered) is None
    assert believed_frame(PosePriors(), registered) is None


def test_on_a_line_orientations_fix_the_rotation():
    straight = {
        f"{k}": RigidTransform(Rotation.from_euler("y", 2.0 * k, degrees=True).as_matrix(), [0.5 * k, 0, 0])
        for k in range(8)
    }
    frame = believed_frame(priors_of(straight, 0.001), straight)
    assert isinstance(frame, PriorFrame)
    assert frame.oriented
    np.testing.assert_allclose(frame.world_from_model.rotation, WORLD_FROM_MODEL.rotation, atol=0.02)
    turned = {name: _turned(prior) for name, prior in priors_of(straight, 0.001).by_name.items()}
    assert believed_frame(PosePriors(by_name=turned), straight) is None  # they contradict the line
    assert orientations_contradict(PosePriors(by_name=turned), straight)
    positions = PosePriors(
        by_name={
            name: PosePrior(position=prior.position) for name, prior in priors_of(straight).by_name.items()
        }
    )
    assert believed_frame(positions, straight) is None
