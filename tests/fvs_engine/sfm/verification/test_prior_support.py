import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform, SimilarityTransform, look_at
from fvs_engine.sfm.pose_priors import PosePrior, PosePriors
from fvs_engine.sfm.settings import GateSettings
from fvs_engine.sfm.verification.pair_check import PairCheck
from fvs_engine.sfm.verification.prior_support import prior_support

WORLD_FROM_MODEL = SimilarityTransform(
    3.0, Rotation.from_rotvec([0.4, -1.1, 0.7]).as_matrix(), np.array([5.0, -2.0, 9.0])
)
COUNT = 16
NAMES = {k: f"{k:02}" for k in range(COUNT)}
SIGMA = 0.25  # in the world, where the cameras' spread is about 14


def ring() -> dict[int, RigidTransform]:
    """model_from_camera of cameras around the middle, at two heights."""
    angles = np.linspace(0.0, 2.0 * np.pi, COUNT, endpoint=False)
    return {
        k: look_at([4.5 * np.cos(a), 4.5 * np.sin(a), k % 2], np.zeros(3), np.array([0.0, 0.0, 1.0]))
        for k, a in enumerate(angles)
    }


def baselines(poses: dict[int, RigidTransform]) -> list[PairCheck]:
    """Pairs of cameras up to four apart, with what they see of each other."""
    checks = []
    for first in poses:
        for step in range(1, 5):
            second = (first + step) % COUNT
            seen = poses[first].inverse().apply(poses[second].translation)
            checks.append(seeing(first, second, seen))
    return checks


def seeing(first: int, second: int, direction: np.ndarray) -> PairCheck:
    """A pair whose first camera sees the second in ``direction``."""
    return PairCheck(first, second, 100, 100, 2000.0, 0.0, 0.0, RigidTransform(np.eye(3), -direction))


def rotations(poses: dict[int, RigidTransform]) -> dict[int, np.ndarray]:
    return {k: pose.rotation for k, pose in poses.items()}


def priors(order: list[int], *, oriented: bool = False, sigma_deg: float = 5.0) -> PosePriors:
    """Position priors with noise: camera k has that of camera ``order[k]``."""
    random, poses = np.random.default_rng(2), ring()
    by_name = {}
    for k, other in enumerate(order):
        world = WORLD_FROM_MODEL.move_camera(poses[other])
        turn = Rotation.from_rotvec(np.deg2rad(sigma_deg) * random.normal(size=3)).as_matrix()
        noisy = RigidTransform(turn @ world.rotation, world.translation + SIGMA * random.normal(size=3))
        whole = PosePrior.of_camera(noisy, SIGMA, sigma_deg)
        by_name[NAMES[k]] = whole if oriented else PosePrior.at(noisy.translation, SIGMA)
    return PosePriors(by_name=by_name)


def test_good_priors_fit_the_pairs_and_those_of_other_images_do_not():
    checks, known = baselines(ring()), rotations(ring())
    good = prior_support(checks, NAMES, known, priors(list(range(COUNT))))
    shuffled = np.random.default_rng(0).permutation(COUNT).tolist()
    bad = prior_support(checks, NAMES, known, priors(shuffled))
    assert good == pytest.approx(1.0, abs=0.05)
    assert bad is not None
    assert bad < GateSettings().min_prior_support


def test_the_priors_of_a_wrong_model_still_fit_its_pairs():
    """A third of the pairs are wrong; orientations help where all rotations of the model are wrong."""
    random = np.random.default_rng(3)
    checks = baselines(ring())
    for index in random.choice(len(checks), size=len(checks) // 3, replace=False):
        check = checks[index]
        away = random.normal(size=3)
        checks[index] = seeing(check.first, check.second, away)
    order = list(range(COUNT))
    by_model = prior_support(checks, NAMES, rotations(ring()), priors(order))
    assert by_model is not None
    assert by_model >= GateSettings().min_prior_support
    wrong = {k: Rotation.random(rng=random).as_matrix() for k in range(COUNT)}
    without = prior_support(checks, NAMES, wrong, priors(order))
    oriented = prior_support(checks, NAMES, wrong, priors(order, oriented=True))
    assert without is not None
    assert oriented is not None
    assert without < GateSettings().min_prior_support <= oriented


def test_few_pairs_and_baselines_within_the_noise_say_nothing():
    checks, known, order = baselines(ring()), rotations(ring()), list(range(COUNT))
    assert prior_support(checks[:5], NAMES, known, priors(order)) is None
    assert prior_support(checks, NAMES, known, PosePriors()) is None
    coarse = {
        name: PosePrior(position=prior.position, position_sigma=20.0)
        for name, prior in priors(order).by_name.items()
    }
    assert prior_support(checks, NAMES, known, PosePriors(by_name=coarse)) is None
