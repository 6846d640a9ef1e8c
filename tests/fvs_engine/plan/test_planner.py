"""Plans against all sets that there are."""

import itertools

import numpy as np
import pytest

from fvs_engine.plan.beam_search import plan_way
from fvs_engine.plan.kriging import TargetVariance
from fvs_engine.plan.planner import plan_views
from fvs_engine.plan.reach import Reach


def a_variance(seed: int, candidates: int = 9) -> tuple[TargetVariance, np.ndarray]:
    draw = np.random.default_rng(seed)
    points = draw.normal(size=(candidates, 6))
    return TargetVariance(draw.normal(size=(30, 6)), points, draw.normal(size=(2, 6))), points[:, :3]


def everything(_plan):
    return np.ones(9, dtype=bool)


def test_a_plan_is_the_best_of_all_sets_nearly_always_and_never_far_off():
    exact = 0
    for seed in range(20):
        variance, _ = a_variance(seed)
        plan = plan_views(variance, 3, everything)
        best = min(variance.variance_after(chosen) for chosen in itertools.combinations(range(9), 3))
        assert plan.variance_after == pytest.approx(variance.variance_after(plan.chosen))
        assert plan.variance - plan.variance_after >= 0.97 * (variance.variance - best)
        exact += plan.variance_after <= best + 1e-9
    assert exact >= 18


def test_exchanges_undo_what_a_greedy_choice_began_with():
    """Of poses on a line the first choice is the middle one, which two views do not need."""
    line = np.linspace(-1.0, 1.0, 21)[:, None] * np.eye(6)[:1]
    variance = TargetVariance(line, line, np.zeros((0, 6)))
    assert int(np.argmax(variance.gains([]))) == 10
    second = variance.gains([10])
    second[10] = -1
    greedy = variance.variance_after([10, int(np.argmax(second))])
    plan = plan_views(variance, 2, lambda _plan: np.ones(21, dtype=bool))
    best = min(variance.variance_after(pair) for pair in itertools.combinations(range(21), 2))
    assert plan.variance_after == pytest.approx(best)
    assert plan.variance_after < greedy - 0.01
    assert 10 not in plan.chosen


def test_gains_add_up_and_fall():
    variance, _ = a_variance(0)
    plan = plan_views(variance, 5, everything)
    assert sum(plan.gains) == pytest.approx(plan.variance - plan.variance_after)
    assert len(set(plan.chosen)) == 5
    assert plan.gains[0] == max(plan.gains)


def test_ends_tell_what_another_next_view_costs():
    variance, _ = a_variance(3)
    plan = plan_views(variance, 3, everything)
    for index in range(9):
        if index in plan.chosen:
            assert plan.ends[index] == plan.variance_after
        else:
            exchanged = min(
                variance.variance_after([*(set(plan.chosen) - {left}), index]) for left in plan.chosen
            )
            assert plan.ends[index] == pytest.approx(exchanged)
            assert plan.ends[index] >= plan.variance_after - 1e-9


def test_a_plan_takes_all_that_there_is_and_stops():
    variance, _ = a_variance(0)
    assert sorted(plan_views(variance, 99, everything).chosen) == list(range(9))
    nothing = plan_views(variance, 3, lambda _plan: np.zeros(9, dtype=bool))
    assert nothing.chosen == ()
    assert nothing.variance_after == nothing.variance
    assert np.isinf(nothing.ends).all()


def test_what_becomes_admissible_by_a_bridge_comes_with_its_bridge():
    """Candidate 1 is admissible only beside 0, and 2 only beside 1."""
    variance, _ = a_variance(1)

    def chain(plan):
        mask = np.zeros(9, dtype=bool)
        mask[[0, 5]] = True
        mask[1] = 0 in plan
        mask[2] = 0 in plan and 1 in plan
        return mask

    for count in (1, 2, 3, 4):
        plan = plan_views(variance, count, chain)
        assert len(plan.chosen) == count
        assert set(plan.chosen) <= {0, 1, 2, 5}
        assert 1 not in plan.chosen or 0 in plan.chosen
        assert 2 not in plan.chosen or 1 in plan.chosen
        assert np.isinf(plan.ends[1])  # it cannot be next


def test_ways_are_the_best_of_all_ways_in_reach():
    for seed in range(5):
        variance, centres = a_variance(seed)
        here, reach = np.zeros(3), Reach(nearest=3)
        names = {str(index): centre for index, centre in enumerate(centres)}

        def ways(place, taken, left, names=names, reach=reach, centres=centres):
            if not left:
                yield taken
                return
            free = {name: centre for name, centre in names.items() if int(name) not in taken}
            for name in reach.distances(place, free):
                yield from ways(centres[int(name)], (*taken, int(name)), left - 1)

        best = min(variance.variance_after(way) for way in ways(here, (), 4))
        plan = plan_way(variance, 4, everything, centres=centres, here=here, reach=reach)
        assert plan.variance_after == pytest.approx(best)
        assert sum(plan.gains) == pytest.approx(plan.variance - best)
        near = [int(name) for name in reach.distances(here, names)]
        assert np.flatnonzero(np.isfinite(plan.ends)).tolist() == sorted(near)
        assert plan.ends[plan.chosen[0]] == pytest.approx(plan.variance_after)


def test_a_way_ends_where_nothing_is_in_reach():
    variance, centres = a_variance(0)
    centres = centres + np.arange(9)[:, None] * 100.0
    plan = plan_way(variance, 3, everything, centres=centres, here=centres[0], reach=Reach(radius=5.0))
    assert plan.chosen == (0,)
    alone = plan_way(variance, 3, everything, centres=centres, here=np.full(3, 9e3), reach=Reach(radius=5.0))
    assert alone.chosen == ()
    assert alone.variance_after == alone.variance


def test_a_way_keeps_to_a_distance_and_spends_it_well():
    """Compare with exhaustive search: a long step gains more than a short one, and is the last."""
    shares = []
    for seed in range(6):
        variance, centres = a_variance(seed)
        here, reach, distance = np.zeros(3), Reach(nearest=4), 3.0
        names = {str(index): centre for index, centre in enumerate(centres)}

        def ways(place, taken, left, names=names, reach=reach, centres=centres):
            yield taken
            free = {name: centre for name, centre in names.items() if int(name) not in taken}
            for name, length in reach.distances(place, free).items():
                if length <= left and len(taken) < 4:
                    yield from ways(centres[int(name)], (*taken, int(name)), left - length)

        best = min(variance.variance_after(way) for way in ways(here, (), distance))
        plan = plan_way(
            variance, 4, everything, centres=centres, here=here, reach=reach, distance=distance, width=3
        )
        way = np.concatenate([here[None], centres[list(plan.chosen)]])
        assert np.linalg.norm(np.diff(way, axis=0), axis=1).sum() <= distance
        assert plan.variance_after == pytest.approx(variance.variance_after(plan.chosen))
        shares.append((plan.variance - plan.variance_after) / (plan.variance - best))
        found = plan.ends[np.isfinite(plan.ends)]
        assert found.min() == pytest.approx(plan.variance_after)
    assert max(shares) <= 1 + 1e-9
    assert min(shares) > 0.9
