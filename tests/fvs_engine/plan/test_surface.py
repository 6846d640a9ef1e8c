"""Places of a surface, and how little is known of them, over blocks of cameras that look down on a plain."""

import numpy as np
import pytest

from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.kriging import variances
from fvs_engine.plan.surface import Surface, surface_of

REACH = 1.6
"""How far from its foot a camera sees the plain."""


def block(columns: list[int], rows: int = 9) -> np.ndarray:
    """Centres of cameras above the plain, 4 high."""
    return np.array([[x, y, 4.0] for x in columns for y in range(rows)], dtype=np.float64)


def plain(cameras: np.ndarray, step: float = 0.25) -> Observations:
    """Points of a plain that reaches over the block, and which cameras saw them."""
    along = np.arange(-1.0, 17.0, step)
    points = np.array([[x, y, 0.0] for x in along for y in np.arange(-1.0, 9.0, step)])
    near = np.abs(points[:, None, :2] - cameras[None, :, :2]).max(axis=2) <= REACH
    points, near = points[near.any(axis=1)], near[near.any(axis=1)]
    observed, camera = np.nonzero(near)
    return Observations(points, observed, cameras[camera])


def known(surface: Surface, cameras: np.ndarray) -> np.ndarray:
    scale = 4.0
    views = np.concatenate([cameras / scale, np.tile([0.0, 0.0, -1.0], (len(cameras), 1))], axis=1)
    return variances(surface.view_points(scale), views)


def test_where_a_strip_of_photographs_is_missing_least_is_known() -> None:
    missing = range(6, 10)
    cameras = block([x for x in range(16) if x not in missing])
    surface = surface_of(plain(cameras), 400)
    found = known(surface, cameras)
    inside = np.flatnonzero((surface.places[:, 1] > 1.0) & (surface.places[:, 1] < 7.0))
    worst = surface.places[inside[np.argsort(-found[inside])[:20]], 0]
    within_strip = (worst > 5.0) & (worst < 10.0)
    at_the_ends = (worst < 1.0) | (worst > 14.0)
    assert within_strip.any()
    assert (within_strip | at_the_ends).all()
    whole = block(list(range(16)))
    strip = np.abs(surface.places[:, 0] - 7.5) < 2.0
    rise = found - known(surface, whole)
    assert rise[strip].min() > 5 * rise[np.abs(surface.places[:, 0] - 7.5) > 5.5].max()


def test_less_is_known_of_an_edge_than_of_a_place_that_is_surrounded() -> None:
    cameras = block(list(range(16)))
    surface = surface_of(plain(cameras), 400)
    found, (x, y, _) = known(surface, cameras), surface.places.T
    surrounded = found[(np.abs(x - 7.5) < 3.0) & (np.abs(y - 4.0) < 1.5)]
    edge = found[(np.abs(x - 7.5) > 7.0) | (np.abs(y - 4.0) > 4.0)]
    assert edge.min() > surrounded.max()


def test_places_are_an_even_share_of_the_surface() -> None:
    cameras = block(list(range(16)))
    sparse = plain(cameras)
    draw = np.random.default_rng(0)
    heap = np.concatenate([draw.uniform(3.0, 4.0, (20_000, 2)), np.zeros((20_000, 1))], axis=1)
    points = np.concatenate([sparse.points, heap])
    observed = np.concatenate([sparse.observed_point, np.arange(len(heap)) + len(sparse.points)])
    seen_from = np.concatenate([sparse.seen_from, np.tile([3.5, 3.5, 4.0], (len(heap), 1))])
    surface = surface_of(Observations(points, observed, seen_from), 500)
    assert 350 <= len(surface.places) <= 500
    in_heap = ((surface.places[:, :2] > 3.0) & (surface.places[:, :2] < 4.0)).all(axis=1)
    assert in_heap.mean() < 0.02  # it has 90 % of the points, and a hundredth of the area


def test_a_view_of_a_place_is_where_its_photographs_were_and_looks_at_it() -> None:
    cameras = np.array([[0.0, 0.0, 4.0], [3.0, 0.0, 4.0]])
    points = np.array([[0.0, 0.0, 0.0], [9.0, 9.0, 0.0], [0.0, 5.0, 0.0]])
    seen = Observations(points, np.array([0, 0, 2]), np.array([*cameras, [0.0, 5.0, 2.0]]))
    surface = surface_of(seen, 10)
    np.testing.assert_allclose(surface.places, points[[0, 2]])  # nobody saw the other one
    centres, directions = surface.views[:, :3], surface.views[:, 3:]
    np.testing.assert_allclose(centres[1], [0.0, 5.0, 2.0])
    np.testing.assert_allclose(directions[1], [0.0, 0.0, -1.0])
    between = (cameras[0] / 4.0 + cameras[1] / 5.0) / np.linalg.norm(cameras[0] / 4.0 + cameras[1] / 5.0)
    np.testing.assert_allclose(centres[0], 4.5 * between)
    np.testing.assert_allclose(directions[0], -between)


@pytest.mark.parametrize("count", [1, 7])
def test_points_in_one_place_are_one_place(count: int) -> None:
    points = np.ones((count, 3))
    seen = Observations(points, np.arange(count), np.zeros((count, 3)))
    np.testing.assert_allclose(surface_of(seen, 1).places, np.ones((1, 3)))
