import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import RigidTransform
from fvs_engine.sfm.verification.evidence import cycle_consistency
from fvs_engine.sfm.verification.pair_check import PairCheck, angle_deg, supported


def views_of(
    points: np.ndarray, rotation: np.ndarray, translation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    second = points @ rotation.T + translation
    return points[:, :2] / points[:, 2:], second[:, :2] / second[:, 2:]


@given(st.integers(0, 10_000))
def test_right_poses_explain_all_matches_and_wrong_ones_few(seed: int):
    generator = np.random.default_rng(seed)
    points = generator.uniform([-2, -2, 4], [2, 2, 8], size=(200, 3))
    rotation = Rotation.from_euler("y", generator.uniform(-0.2, 0.2)).as_matrix()
    translation = np.array([1.0, generator.uniform(-0.5, 0.5), generator.uniform(-0.5, 0.5)])
    first, second = views_of(points, rotation, translation)
    assert supported(first, second, rotation, translation, 0.003).all()
    # The mirrored baseline has the same epipolar lines; only depth betrays it.
    assert not supported(first, second, rotation, -translation, 0.003).any()
    turned = Rotation.from_euler("x", 0.15).as_matrix() @ rotation
    assert supported(first, second, turned, translation, 0.003).mean() < 0.3


@given(st.floats(0.0, 180.0), st.integers(0, 1000))
def test_angle_of_a_rotation(degrees: float, seed: int):
    axis = np.random.default_rng(seed).normal(size=3)
    rotation = Rotation.from_rotvec(np.radians(degrees) * axis / np.linalg.norm(axis)).as_matrix()
    assert angle_deg(rotation) == pytest.approx(degrees, abs=1e-5)


def triplet(error_deg: float) -> list[PairCheck]:
    rotations = Rotation.from_euler("xyz", [[0, 0, 0], [10, 20, 0], [0, 40, 15]], degrees=True).as_matrix()
    wrong = Rotation.from_euler("z", error_deg, degrees=True).as_matrix()
    relative = {(1, 2): rotations[1], (1, 3): wrong @ rotations[2], (2, 3): rotations[2] @ rotations[1].T}
    return [
        PairCheck(i, j, 20, 20, 100.0, 0.0, 0.0, RigidTransform(rotation, np.array([1.0, 0.0, 0.0])))
        for (i, j), rotation in relative.items()
    ]


def test_cycles_close_or_do_not():
    assert cycle_consistency(triplet(0.0)) == 1.0
    assert cycle_consistency(triplet(4.0)) == 1.0
    assert cycle_consistency(triplet(6.0)) == 0.0
    assert cycle_consistency(triplet(0.0)[:2]) is None
