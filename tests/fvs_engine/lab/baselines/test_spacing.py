"""The selectors that look at poses and order only, against brute force."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import RigidTransform
from fvs_engine.lab.baselines import create_selector
from fvs_engine.lab.baselines.uniform import planned_indices
from fvs_engine.plan.distances import view_distances
from fvs_engine.views import PinholeView


def values(scores):
    return [score.score for score in scores]


def test_farthest_is_brute_force_over_position_and_direction(context, view_at):
    draw = np.random.default_rng(0)
    views = [view_at(str(i), draw.normal(size=3) * 5, target=draw.normal(size=3)) for i in range(12)]
    visited, candidates = views[:4], views[4:]
    poses = [view.camera_from_model.inverse() for view in views]
    centres = np.array([pose.translation for pose in poses])
    spread = np.sqrt(((centres - centres.mean(0)) ** 2).sum(1).mean())
    expected = []
    for candidate in poses[4:]:
        nearest = np.inf
        for other in poses[:4]:
            apart = (candidate.translation - other.translation) / spread
            turned = (candidate.rotation - other.rotation) @ [0, 0, 1]
            nearest = min(nearest, np.sqrt(apart @ apart + turned @ turned))
        expected.append(-nearest)
    assert values(create_selector("farthest").score(context(visited, candidates))) == pytest.approx(expected)


def test_farthest_sees_directions_where_positions_are_the_same_and_ignores_scale(view_at, context):
    visited = [view_at("a", (3, 0, 0))]
    turned, rolled = view_at("turned", (3, 0, 0), target=(9, 0, 0)), view_at("same", (3, 0, 0))
    found = values(create_selector("farthest").score(context(visited, [turned, rolled])))
    assert found == pytest.approx([-2, 0])
    small = [view_at(str(i), (i, 2, 0)) for i in range(4)]
    large = [
        PinholeView(
            v.name,
            v.camera,
            RigidTransform(v.camera_from_model.rotation, 7 * v.camera_from_model.translation),
        )
        for v in small
    ]
    np.testing.assert_allclose(view_distances(small, small), view_distances(large, large), atol=1e-12)


def test_nearest_starts_at_the_last_visited_view(context, view_at, chosen_in_turn):
    visited = [view_at("first", (0, 5, 0)), view_at("last", (10, 5, 0))]
    candidates = [view_at("near first", (1, 5, 0)), view_at("near last", (7, 5, 0))]
    here = context(visited, candidates)
    assert values(create_selector("nearest").score(here)) == pytest.approx([9, 3])
    assert chosen_in_turn(here, create_selector("nearest"), 2) == ["near last", "near first"]
    with pytest.raises(InvalidInputError):
        create_selector("nearest").score(context([], candidates))


def test_random_depends_on_seed_step_and_id_alone(context, ring):
    candidates = ring(*range(0, 360, 2))
    random = create_selector("random")
    first = values(random.score(context(ring(1), candidates)))
    assert first[5] == random.score(context(ring(1, 3), candidates[5:6]))[0].score
    for change in ({"seed": 1}, {"step": 1}):
        assert not set(first) & set(values(random.score(context(ring(1), candidates, **change))))
    histogram, _ = np.histogram(first, bins=4, range=(0, 1))
    assert histogram.sum() == 180
    assert (histogram > 25).all()  # 45 expected; under 25 has a probability of 1e-4


@given(
    total=st.integers(2, 9),
    remaining=st.integers(1, 3),
    visited=st.sets(st.integers(0, 8), min_size=1, max_size=3),
)
def test_planned_indices_leave_the_smallest_largest_gap(total, remaining, visited):
    taken = sorted({place % total for place in visited})

    def largest_gap(places):
        found = sorted(places)
        ends = (2 * (found[0] + 0.5), 2 * (total - 0.5 - found[-1]))
        return max(*ends, *(b - a for a, b in itertools.pairwise(found)), 0.0)

    planned = planned_indices(taken, total, remaining)
    assert len(planned) == remaining
    grid = np.linspace(-0.5, total - 0.5, 4 * total + 1)
    best = min(largest_gap([*taken, *others]) for others in itertools.combinations(grid, remaining))
    assert largest_gap([*taken, *planned]) <= best + 1e-9


def test_nothing_visited_gives_even_indices():
    assert planned_indices([], 100, 4) == pytest.approx([12, 37, 62, 87])


def test_uniform_fills_the_order_of_capture_evenly(context, view_at, chosen_in_turn):
    views = [view_at(f"{i:03d}", (i, 5, 0)) for i in range(100)]
    order = {view.name: i for i, view in enumerate(views)}
    here = context(views[:10], views[10:], order=order, budget=19)
    chosen = chosen_in_turn(here, create_selector("uniform"), 9)
    places = [9, *sorted(order[name] for name in chosen)]
    assert set(np.diff(places)) <= {9, 10}
    assert 100 - places[-1] in {4, 5, 6}
