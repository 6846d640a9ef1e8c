import itertools

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import (
    OPENGL_FROM_OPENCV,
    PinholeCamera,
    RigidTransform,
    angle_between,
    halfway_between_neighbours,
    look_at,
    look_at_from_each,
    smooth_path,
)

coordinates = st.floats(-50, 50)
vectors = st.tuples(coordinates, coordinates, coordinates).map(np.array)
CAMERA = PinholeCamera(640, 480, 500.0, 500.0, 320.0, 240.0)


def random_camera(generator: np.random.Generator) -> RigidTransform:
    rotation = Rotation.random(random_state=int(generator.integers(1 << 30))).as_matrix()
    return RigidTransform(rotation, generator.uniform(-5, 5, 3))


@given(centre=vectors, target=vectors, up=vectors)
def test_look_at_puts_the_target_in_the_middle_and_up_above_it(centre, target, up):
    distance = np.linalg.norm(target - centre)
    assume(distance > 1e-3)
    assume(np.linalg.norm(np.cross(target - centre, up)) > 1e-2 * distance * max(np.linalg.norm(up), 1e-3))
    camera_from_model = look_at(centre, target, up).inverse()
    np.testing.assert_allclose(camera_from_model.apply(target), [0, 0, distance], atol=1e-9)
    step = 1e-3 * distance * np.asarray(up) / np.linalg.norm(up)  # never behind the camera
    above = CAMERA.project(camera_from_model.apply(target) + camera_from_model.rotation @ step)
    assert above[0] == pytest.approx(320, abs=1e-6)
    assert above[1] < 240


@pytest.mark.parametrize("up", [[0, 0, 1], [0, 0, -1], [0, 0, 1e-12]])
def test_looking_straight_down_is_still_a_camera(up):
    down = look_at([1, 2, 10], [1, 2, 0], up)
    np.testing.assert_allclose(down.inverse().apply([1, 2, 0]), [0, 0, 10], atol=1e-12)


def test_a_camera_cannot_look_at_itself_or_without_up():
    with pytest.raises(InvalidInputError):
        look_at([1, 2, 3], [1, 2, 3], [0, 0, 1])
    with pytest.raises(InvalidInputError):
        look_at([1, 2, 3], [1, 2, 4], [0, 0, 0])
    with pytest.raises(InvalidInputError):
        look_at([1, np.nan, 3], [1, 2, 4], [0, 0, 1])


def test_cameras_that_look_at_targets_together_are_those_one_by_one():
    centres = [[1.0, 2, 10], [3, 0, 0], [1, 2, 3], [-4, 1, 2]]
    for targets in ([1.0, 2, 3], [[1.0, 2, 0], [0, 0, 0], [1, 2, 3], [5, 5, 5]]):
        cameras = look_at_from_each(centres, targets, [0, 0, 1])
        assert cameras[2] is None  # its target is its centre
        for place in (0, 1, 3):
            alone = look_at(centres[place], np.broadcast_to(targets, (4, 3))[place], [0, 0, 1])
            np.testing.assert_allclose(cameras[place].matrix, alone.matrix, atol=1e-14)
    assert look_at_from_each(np.zeros((0, 3)), [1, 0, 0], [0, 0, 1]) == ()


def test_opengl_cameras_look_along_minus_z_with_y_up():
    model_from_opengl_camera = RigidTransform.identity()
    model_from_camera = model_from_opengl_camera @ OPENGL_FROM_OPENCV
    camera_from_model = model_from_camera.inverse()
    np.testing.assert_array_equal(camera_from_model.apply([0, 0, -1]), [0, 0, 1])
    np.testing.assert_array_equal(camera_from_model.apply([0, 1, 0]), [0, -1, 0])
    np.testing.assert_array_equal((OPENGL_FROM_OPENCV @ OPENGL_FROM_OPENCV).matrix, np.eye(4))


@given(seed=st.integers(0, 10_000))
def test_halfway_is_half_the_move_and_half_the_turn_the_short_way(seed):
    generator = np.random.default_rng(seed)
    first, second = random_camera(generator), random_camera(generator)
    (between,) = halfway_between_neighbours([first, second]).values()
    np.testing.assert_allclose(between.translation, (first.translation + second.translation) / 2)
    whole = angle_between(first.rotation, second.rotation)
    assert angle_between(first.rotation, between.rotation) == pytest.approx(whole / 2, abs=1e-7)
    assert angle_between(between.rotation, second.rotation) == pytest.approx(whole / 2, abs=1e-7)


def test_every_camera_is_paired_with_the_two_nearest():
    places = [0.0, 1.0, 2.1, 3.3, 9.0]
    row = [RigidTransform(np.eye(3), np.array([x, 0, 0])) for x in places]
    assert list(halfway_between_neighbours(row)) == [(0, 1), (0, 2), (1, 2), (1, 3), (2, 3), (2, 4), (3, 4)]
    assert halfway_between_neighbours(row[:1]) == {}


@given(seed=st.integers(0, 10_000), keys=st.integers(2, 8))
def test_a_path_starts_and_ends_where_it_should_and_never_jumps(seed, keys):
    generator = np.random.default_rng(seed)
    angles = np.cumsum(generator.uniform(0.2, 0.6, keys))
    cameras = [look_at([3 * np.cos(a), 3 * np.sin(a), 1], [0, 0, 0], [0, 0, 1]) for a in angles]
    path = smooth_path(cameras, 200)
    assert len(path) == 200
    np.testing.assert_allclose(path[0].matrix, cameras[0].matrix, atol=1e-9)
    np.testing.assert_allclose(path[-1].matrix, cameras[-1].matrix, atol=1e-9)
    centres = np.stack([camera.translation for camera in path])
    steps = np.linalg.norm(np.diff(centres, axis=0), axis=1)
    turns = [angle_between(a.rotation, b.rotation) for a, b in itertools.pairwise(path)]
    assert steps.max() < 2 * steps.mean()
    assert max(turns) < 2 * np.mean(turns)
    for camera in cameras:  # every key is passed, within half a step
        assert np.linalg.norm(centres - camera.translation, axis=1).min() <= steps.max()


def test_a_path_may_pause_turn_on_the_spot_or_have_one_camera():
    first = look_at([3, 0, 0], [0, 0, 0], [0, 0, 1])
    turned = look_at([3, 0, 0], [3, 5, 0], [0, 0, 1])
    assert len(smooth_path([first], 4)) == 4
    path = smooth_path([first, first, turned, turned], 5)
    assert angle_between(path[0].rotation, path[2].rotation) == pytest.approx(np.pi / 4)
    np.testing.assert_allclose(path[2].translation, [3, 0, 0])
    with pytest.raises(InvalidInputError):
        smooth_path([], 5)
    with pytest.raises(InvalidInputError):
        smooth_path([first], 0)
