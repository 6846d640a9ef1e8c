import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import OPENGL_FROM_OPENCV, RigidTransform, SimilarityTransform, angle_between
from fvs_engine.geometry.alignment.dataset import align_dataset

SEEDS = st.integers(0, 2**32 - 1)


def random_rotations(count: int, draw: np.random.Generator) -> np.ndarray:
    return Rotation.random(count, rng=draw).as_matrix()


def cameras_at(centres: np.ndarray, draw: np.random.Generator) -> list[RigidTransform]:
    return list(map(RigidTransform, random_rotations(len(centres), draw), centres))


def random_similarity(draw: np.random.Generator) -> SimilarityTransform:
    scale = draw.uniform(0.01, 100)
    return SimilarityTransform(scale, random_rotations(1, draw)[0], 10 * draw.normal(size=3))


def assert_same(found: SimilarityTransform, expected: SimilarityTransform, tolerance: float = 1e-6) -> None:
    assert found.scale == pytest.approx(expected.scale, rel=tolerance)
    assert np.degrees(angle_between(found.rotation, expected.rotation)) < 57 * tolerance
    size = np.abs(expected.translation).max() + expected.scale
    np.testing.assert_allclose(found.translation, expected.translation, atol=10 * tolerance * size)


@settings(max_examples=25)
@given(SEEDS, st.integers(4, 12))
def test_it_finds_the_similarity(seed: int, count: int) -> None:
    draw = np.random.default_rng(seed)
    world, truth = cameras_at(draw.normal(size=(count, 3)), draw), random_similarity(draw)
    found = align_dataset(world, [truth.move_camera(view) for view in world])
    assert_same(found.model_from_world, truth)
    assert found.source == "centres"
    assert found.rms < 1e-6
    assert found.attitude_deg < 1e-4


@settings(max_examples=25)
@given(SEEDS, st.integers(2, 8))
def test_a_straight_track_takes_its_rotation_from_the_attitudes(seed: int, count: int) -> None:
    draw = np.random.default_rng(seed)
    along = draw.normal(size=3)
    centres = draw.normal(size=3) + np.arange(count)[:, None] * along / np.linalg.norm(along)
    world, truth = cameras_at(centres, draw), random_similarity(draw)
    found = align_dataset(world, [truth.move_camera(view) for view in world])
    assert found.source == "attitudes"
    assert_same(found.model_from_world, truth)


def test_on_a_straight_track_a_single_wrong_attitude_is_outvoted() -> None:
    draw = np.random.default_rng(3)
    world = cameras_at(np.arange(7)[:, None] * np.array([1.0, 0.0, 0.0]), draw)
    truth = random_similarity(draw)
    model = [truth.move_camera(view) for view in world]
    model[4] = RigidTransform(random_rotations(1, draw)[0], model[4].translation)
    assert_same(align_dataset(world, model).model_from_world, truth)


def test_a_view_that_was_registered_wrongly_is_outvoted() -> None:
    draw = np.random.default_rng(4)
    world = cameras_at(draw.normal(size=(12, 3)), draw)
    truth = random_similarity(draw)
    model = [truth.move_camera(view) for view in world]
    model[7] = RigidTransform(model[7].rotation, model[7].translation + 5 * truth.scale)
    found = align_dataset(world, model)
    assert_same(found.model_from_world, truth)
    assert found.inliers == 11
    assert found.views == 12


def test_a_handful_of_rough_positions_all_count() -> None:
    """The best three of five would fit each other by chance, and leave the rest behind."""
    draw = np.random.default_rng(11)
    model = cameras_at(draw.normal(size=(5, 3)), draw)
    world = [RigidTransform(v.rotation, v.translation + draw.normal(scale=0.03, size=3)) for v in model]
    assert align_dataset(world, model).inliers == 5


def test_the_misfit_is_in_the_units_of_the_dataset() -> None:
    draw = np.random.default_rng(5)
    centres = draw.normal(size=(200, 3))
    world = cameras_at(centres, draw)
    noisy = centres + draw.normal(scale=0.05, size=centres.shape)
    truth = SimilarityTransform(40.0, np.eye(3), np.zeros(3))
    model = [
        truth.move_camera(RigidTransform(view.rotation, centre))
        for view, centre in zip(world, noisy, strict=True)
    ]
    found = align_dataset(world, model)
    assert found.rms == pytest.approx(0.05 * np.sqrt(3), rel=0.1)


def test_poses_of_other_photographs_contradict_these() -> None:
    draw = np.random.default_rng(6)
    world = cameras_at(draw.normal(size=(10, 3)), draw)
    model = [world[index] for index in np.roll(np.arange(10), 3)]
    with pytest.raises(InvalidInputError, match="contradict the photographs"):
        align_dataset(world, model)


@pytest.mark.parametrize(("noise", "refused"), [(0.05, False), (0.6, True)])
def test_positions_may_be_as_rough_as_gps_and_no_rougher(noise: float, refused: bool) -> None:
    """Positions are spread over √3; their attitudes are right."""
    draw = np.random.default_rng(10)
    model = cameras_at(draw.normal(size=(40, 3)), draw)
    world = [RigidTransform(v.rotation, v.translation + draw.normal(scale=noise, size=3)) for v in model]
    if not refused:
        assert align_dataset(world, model).rms == pytest.approx(noise * np.sqrt(3), rel=0.3)
        return
    with pytest.raises(InvalidInputError, match="positions contradict the photographs"):
        align_dataset(world, model)


def test_attitudes_of_other_axes_contradict_the_photographs() -> None:
    """Positions agree, and every candidate would look backwards."""
    draw = np.random.default_rng(7)
    model = cameras_at(draw.normal(size=(10, 3)), draw)
    world = [view @ OPENGL_FROM_OPENCV for view in model]
    with pytest.raises(InvalidInputError, match=r"differ by 180°"):
        align_dataset(world, model)


def test_two_views_that_swapped_places_fit_no_scale() -> None:
    draw = np.random.default_rng(8)
    first, second = cameras_at(draw.normal(size=(2, 3)), draw)
    swapped = [
        RigidTransform(first.rotation, second.translation),
        RigidTransform(second.rotation, first.translation),
    ]
    with pytest.raises(InvalidInputError, match="no scale fits both"):
        align_dataset([first, second], swapped)


@pytest.mark.parametrize("count", [0, 1])
def test_one_view_aligns_nothing(count: int) -> None:
    views = [RigidTransform.identity()] * count
    with pytest.raises(InvalidInputError, match="two are needed"):
        align_dataset(views, views)


def test_views_from_one_spot_align_nothing() -> None:
    draw = np.random.default_rng(9)
    views = cameras_at(np.ones((5, 3)), draw)
    with pytest.raises(InvalidInputError, match="coincide"):
        align_dataset(views, views)
