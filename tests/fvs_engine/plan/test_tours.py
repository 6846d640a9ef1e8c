"""Tours with a budget of distance and for several vehicles, against all that there are."""

import itertools

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.kriging import TargetVariance
from fvs_engine.plan.route import StraightLegs, shortest_route
from fvs_engine.plan.tours import Budget, plan_tours

COUNT = 8


def setting(seed: int, vehicles: int = 1) -> tuple[TargetVariance, StraightLegs, range]:
    """Targets and candidates at random, and vehicles near the middle."""
    draw = np.random.default_rng(seed)
    candidates = draw.normal(size=(COUNT, 6))
    starts = 0.3 * draw.normal(size=(vehicles, 3))
    variance = TargetVariance(draw.normal(size=(25, 6)), candidates, draw.normal(size=(1, 6)))
    legs = StraightLegs(np.concatenate([candidates[:, :3], starts]))
    return variance, legs, range(COUNT, COUNT + vehicles)


def everything(_plan):
    return np.ones(COUNT, dtype=bool)


def plan(variance, budget, legs, starts, admissible=everything):
    return plan_tours(variance, budget, admissible, legs, starts)


@pytest.mark.parametrize("home", [False, True])
def test_a_distance_is_spent_nearly_as_well_as_possible(home):
    shares = []
    for seed in range(5):
        variance, legs, starts = setting(seed)
        budget = Budget(views=4, distance=4.0, home=home)
        (tour,) = plan(variance, budget, legs, starts)
        assert tour.length <= 4.0 * (1 + 1e-9)
        assert tour.length == pytest.approx(
            shortest_route(legs, COUNT, tour.views, COUNT if home else None)[1]
        )
        best = variance.variance
        for size in range(1, 5):
            for chosen in itertools.combinations(range(COUNT), size):
                if shortest_route(legs, COUNT, chosen, COUNT if home else None)[1] <= 4.0:
                    best = min(best, variance.variance_after(chosen))
        reduced = variance.variance - variance.variance_after(tour.views)
        shares.append(reduced / (variance.variance - best))
    assert min(shares) > 0.85
    assert np.mean(shares) > 0.97


def test_without_a_distance_the_plan_is_that_of_the_planner_on_a_short_route():
    variance, legs, starts = setting(0)
    (tour,) = plan(variance, Budget(views=3), legs, starts)
    best = min(variance.variance_after(chosen) for chosen in itertools.combinations(range(COUNT), 3))
    assert variance.variance_after(tour.views) == pytest.approx(best)
    assert tour.length == pytest.approx(shortest_route(legs, COUNT, tour.views)[1])


def test_vehicles_share_a_plan_so_that_none_flies_far():
    for seed in range(8):
        variance, legs, starts = setting(seed, vehicles=2)
        tours = plan(variance, Budget(views=5), legs, starts)
        chosen = sorted(view for tour in tours for view in tour.views)
        assert len(chosen) == len(set(chosen)) == 5
        best = min(
            max(
                shortest_route(legs, COUNT, part)[1],
                shortest_route(legs, COUNT + 1, sorted(set(chosen) - set(part)))[1],
            )
            for size in range(6)
            for part in itertools.combinations(chosen, size)
        )
        assert max(tour.length for tour in tours) <= 1.15 * best


def test_each_vehicle_has_the_distance():
    variance, legs, starts = setting(1, vehicles=3)
    tours = plan(variance, Budget(views=8, distance=2.5), legs, starts)
    assert all(tour.length <= 2.5 * (1 + 1e-9) for tour in tours)
    (alone,) = plan(variance, Budget(views=8, distance=2.5), legs, starts[:1])
    together = [view for tour in tours for view in tour.views]
    assert len(together) == len(set(together)) > len(alone.views)


def test_a_distance_that_reaches_nothing_is_an_error_that_says_how_much_is_needed():
    variance, legs, starts = setting(0)
    nearest = float(legs.between(np.array(starts), np.arange(COUNT)).min())
    with pytest.raises(InvalidInputError, match=f"nearest is {nearest:.4g} away") as caught:
        plan(variance, Budget(views=3, distance=nearest / 2, home=True), legs, starts)
    assert f"{2 * nearest:.4g}" in str(caught.value.hint)
    (tour,) = plan(variance, Budget(views=3, distance=2 * nearest, home=True), legs, starts)
    assert len(tour.views) >= 1


def test_nothing_admissible_and_no_vehicle_are_errors():
    variance, legs, starts = setting(0)
    with pytest.raises(InvalidInputError, match="No candidate can be visited"):
        plan(variance, Budget(views=3), legs, starts, lambda _plan: np.zeros(COUNT, dtype=bool))
    with pytest.raises(InvalidInputError, match="at least one vehicle"):
        plan(variance, Budget(views=3), legs, [])

    class NoWay:
        def between(self, places, others):
            return np.full((len(places), len(others)), np.inf)

    with pytest.raises(InvalidInputError, match="can be reached"):
        plan(variance, Budget(views=3), NoWay(), starts)


@pytest.mark.parametrize(
    "values", [{"views": 0}, {"views": 1, "distance": 0.0}, {"views": 1, "distance": np.inf}]
)
def test_budgets_are_positive(values):
    with pytest.raises(InvalidInputError):
        Budget(**values)


def test_what_is_behind_a_wall_is_left_out():
    variance, straight, starts = setting(2)

    class Walled:
        """Candidates 0 to 3 cannot be reached."""

        def between(self, places, others):
            lengths = straight.between(places, others)
            cut = (np.asarray(places) < 4)[:, None] ^ (np.asarray(others) < 4)[None]
            return np.where(cut, np.inf, lengths)

    for budget in (Budget(views=3, distance=50.0), Budget(views=3)):
        (tour,) = plan(variance, budget, Walled(), starts)
        assert len(tour.views) == 3
        assert min(tour.views) >= 4
        assert np.isfinite(tour.length)


def test_what_a_vehicle_has_flown_is_taken_from_its_distance():
    variance, legs, starts = setting(1, vehicles=2)
    fresh = plan(variance, Budget(views=8, distance=2.5), legs, starts[:1])
    assert plan(variance, Budget(views=8, distance=4.5, flown=(2.0,)), legs, starts[:1]) == fresh
    one, other = plan(variance, Budget(views=8, distance=4.0, flown=(3.99, 0.0)), legs, starts)
    assert one.length <= 0.01 * (1 + 1e-6)
    assert 0.01 < other.length <= 4.0 * (1 + 1e-9)
    nearest = legs.between(np.array(starts), np.arange(COUNT)).min(axis=1)
    with pytest.raises(InvalidInputError, match="does not reach"):
        plan(variance, Budget(views=3, distance=9.0, flown=tuple(9.0 - nearest / 2)), legs, starts)


@pytest.mark.parametrize("home", [False, True])
@pytest.mark.parametrize("seed", range(6))
def test_the_distance_that_a_hint_gives_is_enough_and_in_the_unit_of_the_user(seed, home):
    variance, legs, starts = setting(seed)
    with pytest.raises(InvalidInputError, match=r"A distance of 0\.0025 does not") as short:
        plan(variance, Budget(views=3, distance=0.001, home=home, scale=2.5), legs, starts)
    least = float(short.value.hint.split()[3])
    (tour,) = plan(variance, Budget(views=3, distance=least / 2.5, home=home), legs, starts)
    assert tour.views
