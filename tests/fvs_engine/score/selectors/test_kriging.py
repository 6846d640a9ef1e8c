"""The planning selector in contexts: what it visits, and in which order."""

import itertools

import numpy as np
import pytest

from fvs_engine.lab.baselines import create_selector
from fvs_engine.plan.distances import path_length
from fvs_engine.plan.familiarity import Observations
from fvs_engine.plan.fleet import Fleet
from fvs_engine.plan.reach import Reach
from fvs_engine.score.selectors import kriging


def a_ring(ring):
    return ring(*range(10, 360, 10))


def test_the_remaining_views_are_planned_together(context, ring, chosen_in_turn):
    """Two views more, one of them seen: greedy choice would take the opposite one first."""
    visited, candidates = ring(0), a_ring(ring)
    here = context(visited, candidates, budget=3)
    chosen = chosen_in_turn(here, create_selector("kriging"), 2)
    variance, index = here.planning.variance, here.planning.index
    pairs = itertools.combinations(range(len(candidates)), 2)
    best = min(variance.variance_after(pair) for pair in pairs)
    # Exchanging single views may miss the best pair, not by much.
    assert variance.variance_after([index[name] for name in chosen]) == pytest.approx(best, rel=1e-3)
    stops = [0, *sorted(map(int, chosen)), 360]
    assert np.diff(stops).min() >= 110  # nearly a third of the ring each


def test_scores_are_the_same_in_whatever_order_candidates_come(context, ring):
    """Sums in another order differ by rounding, which may decide between views that do as well."""
    visited, candidates = ring(0, 20), ring(*range(40, 360, 20))
    order = {view.name: place for place, view in enumerate([*visited, *candidates])}
    scores = create_selector("kriging").score(context(visited, candidates, order=order, budget=6))
    again = create_selector("kriging").score(context(visited, candidates[::-1], order=order, budget=6))
    assert scores == again[::-1]


def test_planned_views_are_visited_along_a_short_way(context, ring, chosen_in_turn):
    visited, candidates = ring(0), a_ring(ring)
    views = {view.name: view for view in (*visited, *candidates)}
    here = context(visited, candidates, budget=6)

    def travel(method: str) -> float:
        names = ["000", *chosen_in_turn(here, create_selector(method), 5)]
        return path_length([views[name].centre for name in names])

    assert travel("kriging") < 0.75 * travel("farthest")


def test_a_limited_reach_is_planned_ahead(context, ring):
    """From 0 only two steps of the ring are in reach, and three steps are left: on, not to and fro."""
    visited, candidates = ring(20, 10, 0), a_ring(ring)[2:]
    here = context(
        visited,
        tuple(view for view in candidates if view.name in {"340", "350", "030"}),
        later=candidates,
        reach=Reach(nearest=3),
        budget=6,
    )
    scores = {score.name: score.score for score in create_selector("kriging").score(here)}
    assert min(scores, key=scores.get) == "340"


def test_with_estimated_poses_only_familiar_views_are_planned(context, ring):
    """All points were seen from 0 degrees: its neighbours can be registered, the other side cannot."""
    draw = np.random.default_rng(0)
    points = 0.2 * draw.normal(size=(500, 3))
    seen_from = np.repeat(ring(0)[0].centre[None], 500, axis=0)
    observations = Observations(points, np.arange(500), seen_from)
    visited, candidates = ring(0), ring(20, 180)
    known = {
        s.name: s.score for s in create_selector("kriging").score(context(visited, candidates, budget=2))
    }
    assert known["180"] < known["020"]
    here = context(visited, candidates, budget=2, observations=observations)
    estimated = {s.name: s.score for s in create_selector("kriging").score(here)}
    assert estimated["020"] < estimated["180"]
    targets = here.planning
    assert [view.name for view in targets.registrable(candidates)] == ["020"]
    assert targets.registrable(candidates[1:]) == candidates[1:]  # nothing better
    far = ring(150, 170, 190)
    beyond = context(visited, far, budget=2, observations=observations).planning
    assert [view.name for view in beyond.registrable(far)] == ["150"]  # the likeliest


def test_a_spent_budget_counts_as_one_view(context, ring):
    here = context(ring(0), ring(90, 180), budget=1)
    scores = create_selector("kriging").score(here)
    assert scores[1].score < scores[0].score


def test_views_in_one_place_are_no_error(context, view_at):
    views = [view_at(str(index), (3, 0, 0), target=(np.cos(index), np.sin(index), 0)) for index in range(6)]
    scores = create_selector("kriging").score(context(views[:1], views[1:], budget=3))
    assert all(np.isfinite(score.score) for score in scores)


def test_the_plan_keeps_to_the_distance_that_is_left(context, ring):
    """With nine views to go the best plan is all around; with little distance left it stays near."""
    visited, candidates = ring(0), a_ring(ring)
    place = visited[0].centre
    selector = create_selector("kriging")

    def scores(left: float) -> dict[str, float]:
        fleet = Fleet(place[None], (2.0,), 2.0 + left)
        found = selector.score(context(visited, candidates, budget=10, fleet=fleet))
        return {score.name: score.score for score in found}

    reached = {view.name for view in candidates if np.linalg.norm(view.centre - place) <= 1.6}
    tight = scores(1.6)
    assert min(tight, key=tight.get) in reached
    assert max(tight[name] for name in reached) < min(tight[name] for name in tight.keys() - reached)
    assert min(scores(8.0).values()) < min(tight.values()) - 0.05


def test_vehicles_on_two_sides_plan_for_their_own_side(context, ring):
    visited, candidates = ring(0, 180), a_ring(ring)
    candidates = tuple(view for view in candidates if view.name != "180")
    places = np.stack([view.centre for view in visited])
    for first in (0, 1):
        order = [first, 1 - first]
        fleet = Fleet(places[order], (0.0, 0.0))
        found = create_selector("kriging").score(
            context(visited, candidates, budget=8, fleet=fleet, here=places[first])
        )
        best = min(found, key=lambda score: score.score).name
        (centre,) = (view.centre for view in candidates if view.name == best)
        apart = np.linalg.norm(places - centre, axis=1)
        assert apart[first] < apart[1 - first]


def test_where_reach_is_limited_vehicles_plan_a_share_each(context, ring, monkeypatch):
    counts = []
    plan_way = kriging.plan_way
    monkeypatch.setattr(
        kriging,
        "plan_way",
        lambda *given, **named: counts.append((given[1], named["distance"])) or plan_way(*given, **named),
    )
    visited, candidates = ring(0), a_ring(ring)
    place = visited[0].centre
    for vehicles, distance in ((1, None), (2, 3.0), (3, None)):
        fleet = Fleet(np.tile(place, (vehicles, 1)), (1.0,) * vehicles, distance)
        kriging.Kriging().score(context(visited, candidates, budget=8, reach=Reach(nearest=4), fleet=fleet))
    assert [count for count, _ in counts] == [7, 4, 3]
    assert [distance for _, distance in counts] == [None, pytest.approx(2.0), None]
