import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform, SimilarityTransform

seeds = st.integers(0, 100_000)


def rigid(generator: np.random.Generator) -> RigidTransform:
    rotation = Rotation.random(random_state=int(generator.integers(1 << 30))).as_matrix()
    return RigidTransform(rotation, generator.uniform(-10, 10, 3))


def similarity(generator: np.random.Generator) -> SimilarityTransform:
    moved = rigid(generator)
    return SimilarityTransform(float(np.exp(generator.uniform(-3, 3))), moved.rotation, moved.translation)


@pytest.mark.parametrize("make", [rigid, similarity])
@given(seed=seeds)
def test_transforms_form_a_group(make, seed):
    generator = np.random.default_rng(seed)
    a_from_b, b_from_c, c_from_d = make(generator), make(generator), make(generator)
    points = generator.normal(size=(5, 3))
    chained = a_from_b.apply(b_from_c.apply(c_from_d.apply(points)))
    tolerance = 1e-10 * (1 + np.abs(chained).max())
    np.testing.assert_allclose((a_from_b @ b_from_c @ c_from_d).apply(points), chained, atol=tolerance)
    np.testing.assert_allclose((a_from_b @ (b_from_c @ c_from_d)).apply(points), chained, atol=tolerance)
    np.testing.assert_allclose(a_from_b.inverse().apply(a_from_b.apply(points)), points, atol=1e-9)
    np.testing.assert_allclose(type(a_from_b).identity().apply(points), points)


@given(seed=seeds)
def test_matrices_say_the_same(seed):
    generator = np.random.default_rng(seed)
    a_from_b = rigid(generator)
    point = generator.normal(size=3)
    np.testing.assert_allclose((a_from_b.matrix @ [*point, 1])[:3], a_from_b.apply(point), atol=1e-12)
    for matrix in (a_from_b.matrix, a_from_b.matrix[:3]):
        np.testing.assert_array_equal(RigidTransform.from_matrix(matrix).matrix, a_from_b.matrix)


@given(seed=seeds)
def test_a_moved_camera_sees_the_moved_scene_the_same_way(seed):
    generator = np.random.default_rng(seed)
    target_from_source, source_from_camera = similarity(generator), rigid(generator)
    seen = generator.normal(size=(6, 3))
    target_from_camera = target_from_source.move_camera(source_from_camera)
    moved = target_from_camera.inverse().apply(target_from_source.apply(source_from_camera.apply(seen)))
    np.testing.assert_allclose(moved, target_from_source.scale * seen, atol=1e-8)


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [
        (np.diag([1, 1, -1]), np.zeros(3)),
        (2 * np.eye(3), np.zeros(3)),
        (np.eye(4), np.zeros(3)),
        (np.full((3, 3), np.nan), np.zeros(3)),
        (np.eye(3), np.array([0, np.inf, 0])),
        (np.eye(3), np.zeros(2)),
    ],
)
def test_what_is_not_rigid_is_refused(rotation, translation):
    with pytest.raises(InvalidInputError):
        RigidTransform(rotation, translation)
    with pytest.raises(InvalidInputError):
        SimilarityTransform(1.0, rotation, translation)


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_impossible_scales_are_refused(scale):
    with pytest.raises(InvalidInputError):
        SimilarityTransform(scale, np.eye(3), np.zeros(3))


def test_a_projective_matrix_is_refused():
    matrix = np.eye(4)
    matrix[3, 0] = 0.1
    with pytest.raises(InvalidInputError):
        RigidTransform.from_matrix(matrix)
    with pytest.raises(InvalidInputError):
        RigidTransform.from_matrix(np.eye(3))


def test_many_transforms_are_those_of_the_constructor():
    generator = np.random.default_rng(4)
    ones = [rigid(generator) for _ in range(5)]
    many = RigidTransform.many([one.rotation for one in ones], [one.translation for one in ones])
    for one, other in zip(ones, many, strict=True):
        np.testing.assert_array_equal(one.matrix, other.matrix)


@pytest.mark.parametrize(
    ("rotation", "translation"),
    [
        (np.diag([1, 1, -1]), np.zeros(3)),
        (2 * np.eye(3), np.zeros(3)),
        (np.full((3, 3), np.nan), np.zeros(3)),
        (np.eye(3), np.array([0, np.inf, 0])),
        (np.eye(3), np.array([0, 0, 1e11])),
        (np.eye(3), np.zeros(2)),
    ],
)
@pytest.mark.parametrize("last", [True, False])
def test_one_of_many_that_is_not_rigid_is_refused(rotation, translation, last):
    rotations, translations = [np.eye(3), rotation], [np.zeros(len(translation)), translation]
    with pytest.raises(InvalidInputError):
        RigidTransform.many(rotations[:: 1 if last else -1], translations[:: 1 if last else -1])
