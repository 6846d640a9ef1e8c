import numpy as np
import pytest

from fvs_engine.splat.view_order import ViewOrder


def order(repeats: list[int], count: int, seed: int = 0) -> list[int]:
    views = ViewOrder(seed, 0, [], repeats)
    return [views.next() for _ in range(count)]


def test_an_epoch_has_every_view_as_often_as_it_repeats() -> None:
    counts = np.bincount(order([1, 3, 1, 5], 20), minlength=4)
    assert counts.tolist() == [2, 6, 2, 10]


def test_single_views_are_in_a_random_order_that_changes_with_epoch_and_seed() -> None:
    first = order([1] * 30, 60)
    assert first[:30] != first[30:] != sorted(first[30:])
    assert order([1] * 30, 30, seed=1) != first[:30]
    assert first[:30] == np.random.default_rng([0, 0]).permutation(30)[::-1].tolist()


@pytest.mark.parametrize("seed", range(5))
def test_a_part_of_an_epoch_has_a_repeated_view_as_often_as_the_whole(seed: int) -> None:
    part = order([49, *[1] * 49], 14, seed)
    assert 6 <= part.count(0) <= 8


@pytest.mark.parametrize("seed", range(5))
def test_several_repeated_views_are_spread_each(seed: int) -> None:
    part = order([20, 20, *[1] * 40], 20, seed)
    assert 4 <= part.count(0) <= 6
    assert 4 <= part.count(1) <= 6
