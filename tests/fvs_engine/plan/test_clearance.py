"""Clearance against all balls, one by one."""

import time

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.clearance import SOLID_OPACITY, FreeSpace, Matter
from fvs_engine.plan.segments import points_distance
from fvs_engine.plan.volumes import Box


def some_matter(seed, count=60):
    """Radii over four orders of magnitude, and some of none."""
    draw = np.random.default_rng(seed)
    radii = 10.0 ** draw.uniform(-4.0, -0.3, size=count)
    radii[: count // 4] = 0.0
    return Matter(draw.uniform(size=(count, 3)), radii)


@given(st.integers(0, 10_000), st.sampled_from([0.0, 0.001, 0.05, 0.3]))
def test_clear_is_farther_than_the_safety_distance_from_every_ball(seed, safety):
    matter = some_matter(seed)
    points = np.random.default_rng(seed + 1).uniform(-0.2, 1.2, size=(100, 3))
    gaps = np.linalg.norm(points[:, None] - matter.centres, axis=-1) - matter.radii
    assert np.array_equal(matter.clear(points, safety), gaps.min(axis=1) > safety)


@given(st.integers(0, 10_000), st.sampled_from([0.001, 0.01, 0.05]))
def test_sight_is_blocked_by_balls_on_the_way_and_by_no_others(seed, safety):
    matter = some_matter(seed, 30)
    draw = np.random.default_rng(seed + 1)
    points, others = draw.uniform(-0.5, 1.5, size=(2, 200, 3))
    distances = points_distance(matter.centres, points[:, None], others[:, None])
    gaps = (distances - matter.radii).min(axis=1)
    sees = matter.sees(points, others, safety)
    # A ball of radius r that is deeper in the way has a chord longer than the part that is not examined.
    unexamined = np.maximum(0.1 * safety, 1e-3 * np.linalg.norm(others - points, axis=1))
    assert not sees[gaps <= safety - unexamined**2 / (8.0 * safety) - 1e-12].any()
    assert sees[gaps > safety + 1e-12].all()


def test_sight_of_oneself_is_clearance():
    matter = some_matter(0)
    points = np.random.default_rng(1).uniform(size=(200, 3))
    assert np.array_equal(matter.sees(points, points, 0.02), matter.clear(points, 0.02))


def test_a_wall_blocks_and_floaters_of_low_opacity_do_not():
    y, z = (axis.ravel() for axis in np.meshgrid(np.arange(-2, 2, 0.1), np.arange(-2, 2, 0.1)))
    wall = np.column_stack([0 * y, y, z])
    floater = np.array([[-1.0, 0.0, 0.0]])
    means = np.concatenate([wall, floater])
    scales = np.full((len(means), 3), 0.1)
    opacities = np.array([*np.full(len(wall), 0.9), 0.5 * SOLID_OPACITY])
    matter = Matter.of_model(means, scales, opacities)
    assert len(matter) == len(wall)
    here, there, beyond = np.array([[-2.0, 0, 0]]), np.array([[-0.5, 0, 0]]), np.array([[1.0, 0, 0]])
    assert matter.sees(here, there, 0.2)[0]
    assert not matter.sees(here, beyond, 0.2)[0]
    point_there = Matter.of_model(means, scales, opacities, points=floater)
    assert not point_there.sees(here, there, 0.2)[0]


def test_without_matter_everything_is_clear():
    points = np.zeros((3, 3))
    assert Matter.none().clear(points, 1.0).all()
    assert Matter.none().sees(points, points + 1.0, 1.0).all()
    assert Matter.none().clear(points[:0], 1.0).shape == (0,)
    for ask in (lambda: Matter.none().middle, lambda: Matter.none().nearest(points)):
        with pytest.raises(InvalidInputError, match="no solid part"):
            ask()


def test_the_middle_is_robust():
    centres = np.concatenate([np.random.default_rng(0).normal(size=(99, 3)), [[1e6, 1e6, 1e6]]])
    assert np.linalg.norm(Matter(centres, np.zeros(100)).middle) < 1.0


@pytest.mark.parametrize("safety", [-1.0, np.nan, np.inf])
def test_safety_distances_are_checked(safety):
    with pytest.raises(InvalidInputError, match="safety distance"):
        Matter.none().clear(np.zeros((1, 3)), safety)
    with pytest.raises(InvalidInputError, match="safety distance"):
        FreeSpace(safety=safety)


def test_matter_and_reach_are_checked():
    with pytest.raises(InvalidInputError, match="as many radii"):
        Matter(np.zeros((2, 3)), np.zeros(3))
    for radius in (-1.0, np.nan):
        with pytest.raises(InvalidInputError, match="at least 0"):
            Matter(np.zeros((1, 3)), np.array([radius]))
    with pytest.raises(InvalidInputError, match="start"):
        FreeSpace(reach=1.0)
    with pytest.raises(InvalidInputError, match="positive"):
        FreeSpace(start=np.zeros(3), reach=0.0)


def test_legs_are_free_where_neither_matter_nor_zones_are():
    space = FreeSpace(
        Matter(np.array([[0.0, 0.0, 0.0]]), np.array([0.5])),
        0.1,
        [Box(centre=(0.0, 3.0, 0.0), size=(1, 1, 1))],
    )
    starts = np.array([[-2.0, 0, 0], [-2.0, 3, 0], [-2.0, 0.61, 0], [-2.0, 0.59, 0]])
    assert space.joins(starts, starts * [-1, 1, 1]).tolist() == [False, False, True, False]


def test_many_gaussians_and_candidates_take_less_than_a_second():
    draw = np.random.default_rng(0)
    surface = draw.normal(size=(100_000, 3))
    surface /= np.linalg.norm(surface, axis=1, keepdims=True)
    matter = Matter(surface, np.exp(draw.normal(-5.0, 0.7, size=100_000)))
    points, others = 2.0 * draw.normal(size=(2, 2_000, 3))
    begun = time.process_time()
    clear, sees = matter.clear(points, 0.05), matter.sees(points, others, 0.05)
    assert time.process_time() - begun < 1.0
    assert clear.any()
    assert 0 < sees.sum() < 2_000
