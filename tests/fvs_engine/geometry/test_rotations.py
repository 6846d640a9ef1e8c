import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import matrix_from_quaternion, quaternion_from_matrix

numbers = st.floats(-10, 10)
quaternions = (
    st.tuples(numbers, numbers, numbers, numbers).map(np.array).filter(lambda q: np.linalg.norm(q) > 1e-3)
)
shares = st.floats(0, 1)


def up_to_sign(quaternion):
    unit = quaternion / np.linalg.norm(quaternion)
    return np.outer(unit, unit)  # the same for q and −q


@given(quaternion=quaternions)
def test_quaternions_survive_the_way_to_a_matrix_and_back(quaternion):
    matrix = matrix_from_quaternion(quaternion)
    np.testing.assert_allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(matrix) == pytest.approx(1)
    back = quaternion_from_matrix(matrix)
    assert back[0] >= 0
    np.testing.assert_allclose(up_to_sign(back), up_to_sign(quaternion), atol=1e-12)


def test_the_scalar_part_comes_first():
    half = np.sqrt(0.5)
    np.testing.assert_allclose(  # a quarter turn about z takes x to y
        matrix_from_quaternion([half, 0, 0, half]) @ [1, 0, 0], [0, 1, 0], atol=1e-15
    )


@given(first=quaternions, second=quaternions)
def test_products_of_quaternions_are_products_of_matrices(first, second):
    w1, v1, w2, v2 = first[0], first[1:], second[0], second[1:]
    product = np.concatenate([[w1 * w2 - v1 @ v2], w1 * v2 + w2 * v1 + np.cross(v1, v2)])
    np.testing.assert_allclose(
        matrix_from_quaternion(first) @ matrix_from_quaternion(second),
        matrix_from_quaternion(product),
        atol=1e-10,
    )


@given(quaternion=quaternions, noise=st.floats(0, 0.1), seed=st.integers(0, 1000))
def test_the_quaternion_of_a_noisy_rotation_is_that_of_the_nearest_one(quaternion, noise, seed):
    noisy = matrix_from_quaternion(quaternion) + noise * np.random.default_rng(seed).uniform(-1, 1, (3, 3))
    left, _, right = np.linalg.svd(noisy)  # its orthogonal factor is the nearest rotation
    np.testing.assert_allclose(
        matrix_from_quaternion(quaternion_from_matrix(noisy)), left @ right, atol=1e-12
    )


@pytest.mark.parametrize("axis", range(3))
def test_half_a_turn_has_one_quaternion(axis):
    half_a_turn = 2.0 * np.outer(np.eye(3)[axis], np.eye(3)[axis]) - np.eye(3)
    np.testing.assert_array_equal(quaternion_from_matrix(half_a_turn), np.eye(4)[axis + 1])


def test_arrays_keep_their_shape():
    many = np.random.default_rng(0).normal(size=(2, 3, 4))
    matrices = matrix_from_quaternion(many)
    assert matrices.shape == (2, 3, 3, 3)
    back = quaternion_from_matrix(matrices)
    assert back.shape == (2, 3, 4)
    np.testing.assert_allclose(matrix_from_quaternion(back), matrices, atol=1e-12)


@pytest.mark.parametrize("quaternion", [[0, 0, 0, 0], [np.nan, 0, 0, 1], [1, 0, 0]])
def test_impossible_quaternions_are_refused(quaternion):
    with pytest.raises(InvalidInputError):
        matrix_from_quaternion(quaternion)


@pytest.mark.parametrize("matrix", [np.diag([1, 1, -1]), np.zeros((3, 3)), np.eye(3) * np.nan, np.eye(4)])
def test_impossible_matrices_are_refused(matrix):
    with pytest.raises(InvalidInputError):
        quaternion_from_matrix(matrix)
