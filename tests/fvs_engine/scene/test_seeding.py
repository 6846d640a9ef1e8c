from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.scene.seeding import GUESSES_PER_VIEW, guessed_seeds, initial_seeds, seeds_on_points
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.views import TrainingView


def grid(side: int) -> NDArray[np.float64]:
    """Points one apart."""
    return np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3).astype(np.float64)


def cloud(xyz: NDArray[np.float64]) -> PointCloud:
    return PointCloud(xyz, np.full((len(xyz), 3), 7, np.uint8))


def test_numbers_and_order_of_points_do_not_count() -> None:
    points = np.random.default_rng(0).normal(size=(300, 3))
    shuffled = np.random.default_rng(1).permutation(points)
    first, second = seeds_on_points(cloud(points), 100), seeds_on_points(cloud(shuffled), 100)
    assert np.array_equal(first.points.xyz, second.points.xyz)
    assert np.array_equal(first.spacing, second.spacing)


def test_few_points_are_completed_by_guesses_whatever_the_order_of_views() -> None:
    views = [view("a", [5.0, 0, 1], 10), view("b", [0, 5.0, 1], 200)]
    many, few = cloud(grid(5)), cloud(grid(2))
    assert len(initial_seeds(many, views, 1000, seed=0)) == 125
    first, second = (initial_seeds(few, order, 1000, seed=0) for order in (views, views[::-1]))
    assert np.array_equal(first.points.xyz[:8], grid(2)[np.lexsort(grid(2).T)])
    assert len(first) == 8 + 2 * (992 // 2)
    assert np.array_equal(first.points.xyz, second.points.xyz)


def test_the_loneliest_points_win_when_room_is_short() -> None:
    points = np.concatenate([grid(4), [[20.0, 0, 0], [30.0, 0, 0]]])
    seeds = seeds_on_points(cloud(points), 2)
    assert sorted(seeds.points.xyz[:, 0]) == [20.0, 30.0]
    assert len(seeds_on_points(cloud(points), 0)) == 0


def test_points_that_are_not_finite_are_no_places() -> None:
    points = grid(3)
    points[5, 1] = np.nan
    seeds = seeds_on_points(cloud(points), 1000)
    assert np.array_equal(np.unique(seeds.points.xyz, axis=0), np.unique(np.delete(points, 5, 0), axis=0))
    assert len(seeds) == 26


def view(name: str, eye: list[float], color: int) -> TrainingView:
    camera = PinholeCamera(40, 30, 40.0, 40.0, 20.0, 15.0)
    image = np.full((30, 40, 3), color, np.uint8)
    return TrainingView(name, camera, look_at(eye, [0, 0, 0], [0, 0, 1]).inverse(), image)


def test_guesses_lie_in_their_views_around_what_all_look_at() -> None:
    views = [view("a", [5.0, 0, 1], 10), view("b", [0, 5.0, 1], 200)]
    seeds = guessed_seeds(views, 100_000, seed=0)
    assert len(seeds) == 2 * GUESSES_PER_VIEW
    for one, color in zip(views, (10, 200), strict=True):
        own = seeds.points.xyz[(seeds.points.colors == color).all(axis=1)]
        local = one.camera_from_model.apply(own)
        assert ((one.camera.project(local) >= 0) & (one.camera.project(local) <= [40, 30])).all()
        assert np.median(local[:, 2]) / np.sqrt(26) < 2
        assert local[:, 2].min() < np.sqrt(26) < local[:, 2].max()
    assert len(guessed_seeds(views, 51, seed=0)) == 50


def test_cameras_that_look_apart_guess_ahead_of_themselves() -> None:
    camera = PinholeCamera(40, 30, 40.0, 40.0, 20.0, 15.0)
    image = np.zeros((30, 40, 3), np.uint8)
    apart = [
        TrainingView(str(i), camera, look_at(eye, np.multiply(eye, 2), [0, 0, 1]).inverse(), image)
        for i, eye in enumerate(([1.0, 0, 0], [-1.0, 0, 0], [0, 1.0, 0]))
    ]
    seeds = guessed_seeds(apart, 9_000, seed=0)
    assert np.isfinite(seeds.points.xyz).all()
    for i, one in enumerate(apart):
        own = seeds.points.xyz[i * GUESSES_PER_VIEW : (i + 1) * GUESSES_PER_VIEW]
        assert (one.camera_from_model.apply(own)[:, 2] > 0).all()


def test_guesses_are_where_photographs_count() -> None:
    whole = [view("a", [5.0, 0, 1], 10), view("b", [0, 5.0, 1], 200)]
    mask = np.tile(np.arange(40) < 10, (30, 1))
    seeds = guessed_seeds([replace(whole[0], mask=mask), whole[1]], 100_000, seed=0)
    assert 0.2 < (seeds.points.colors == 10).mean() / (1 - (seeds.points.colors == 10).mean()) < 0.3
    first = seeds.points.xyz[seeds.points.colors[:, 0] == 10]
    pixels = whole[0].camera.project(whole[0].camera_from_model.apply(first))
    assert pixels[:, 0].max() < 10


def test_points_that_only_masked_pixels_show_are_no_starts() -> None:
    first, second = view("a", [5.0, 0, 0], 10), view("b", [0, 5.0, 0], 200)
    points = cloud(np.array([[0.0, 0, 0.5], [0, 0, -0.5], [0, 0, 90]]))
    upper = np.tile(np.arange(30)[:, None] < 15, (1, 40))
    for views, kept in (
        ([first, second], [0.5, -0.5, 90]),
        ([replace(first, mask=upper), second], [0.5, -0.5, 90]),
        ([replace(first, mask=upper), replace(second, mask=upper)], [0.5, 90]),
    ):
        seeds = initial_seeds(points, views, 10_000, seed=0).points.xyz
        assert [z in seeds[:3, 2] for z in kept] == [True] * len(kept)
        assert (-0.5 in seeds[:3, 2]) == (-0.5 in kept)
