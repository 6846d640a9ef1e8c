"""Routes against all orders that there are."""

import itertools

import numpy as np
import pytest

from fvs_engine.plan.distances import path_length
from fvs_engine.plan.route import StraightLegs, shortest_route


def route(start, stops, end=None):
    """The route through places, as indices of stops."""
    places = np.array([start, *stops, *([] if end is None else [end])])
    last = None if end is None else len(places) - 1
    order, length = shortest_route(StraightLegs(places), 0, range(1, len(stops) + 1), last)
    return [index - 1 for index in order], length


def shortest(start, stops, end=None):
    last = [] if end is None else [end]
    return min(path_length([start, *order, *last]) for order in itertools.permutations(stops))


@pytest.mark.parametrize("has_end", [False, True])
def test_routes_are_the_shortest_of_all_nearly_always(has_end):
    exact = 0
    for seed in range(10):
        draw = np.random.default_rng(seed)
        start, stops = draw.normal(size=3), draw.normal(size=(6, 3))
        end = draw.normal(size=3) if has_end else None
        order, length = route(start, stops, end)
        assert sorted(order) == list(range(6))
        way = [start, *stops[order], *([] if end is None else [end])]
        assert length == pytest.approx(path_length(way))
        best = shortest(start, list(stops), end)
        assert length <= 1.1 * best
        exact += length <= best + 1e-9
    assert exact >= 7


@pytest.mark.parametrize("count", [0, 1, 2])
def test_routes_of_few_stops(count):
    start, stops = np.zeros(3), np.eye(3)[:count]
    order, length = route(start, stops)
    assert sorted(order) == list(range(count))
    assert length == pytest.approx(shortest(start, list(stops)) if count else 0.0)
    assert route(start, stops, start)[1] == pytest.approx(
        shortest(start, list(stops), start) if count else 0.0
    )


def test_stops_in_one_place_are_no_error():
    order, length = route(np.zeros(3), np.ones((5, 3)))
    assert sorted(order) == [0, 1, 2, 3, 4]
    assert length == pytest.approx(np.sqrt(3))


def test_a_ring_is_flown_around_once():
    angles = np.random.default_rng(0).permutation(np.linspace(0, 2 * np.pi, 40, endpoint=False))
    ring = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=1)
    first = int(np.argmin(np.abs(angles)))
    _, length = route(ring[first], ring)
    assert length == pytest.approx(39 * 2 * np.sin(np.pi / 40))
