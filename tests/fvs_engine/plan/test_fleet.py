"""Plans of vehicles on their way, and what is left if one of them goes to a candidate next."""

import numpy as np
import pytest

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.plan.fleet import Fleet, FleetPlan
from fvs_engine.plan.planner import plan_views
from fvs_engine.plan.targets import Targets
from fvs_engine.views import PinholeView

CAMERA = PinholeCamera(32, 24, 28.0, 28.0, 16.0, 12.0)
RADIUS = 3.0


def view(degrees: float) -> PinholeView:
    angle = np.radians(degrees)
    centre = (RADIUS * np.cos(angle), RADIUS * np.sin(angle), 0.3)
    return PinholeView(f"{degrees:05.1f}", CAMERA, look_at(centre, (0, 0, 0), (0, 0, 1)).inverse())


@pytest.fixture(scope="module")
def targets() -> Targets:
    """The view at 0° was visited; candidates are every 10°."""
    return Targets([view(0)], [view(degrees) for degrees in range(10, 360, 10)])


def fleet(*angles: float, flown: tuple[float, ...] = (), distance: float | None = None) -> Fleet:
    centres = np.stack([view(angle).centre for angle in angles])
    return Fleet(centres, flown or (0.0,) * len(angles), distance)


def way_length(targets: Targets, here: np.ndarray, views: list[int] | tuple[int, ...]) -> float:
    places = np.concatenate([here[None], targets.centres[list(views)]])
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def test_tours_keep_to_what_each_vehicle_has_left(targets):
    vehicles = fleet(0, 180, flown=(4.0, 1.0), distance=6.0)
    first, second = FleetPlan(targets, 12, vehicles).tours
    assert 0 < first.length <= 2.0 * (1 + 1e-9)
    assert 2.0 < second.length <= 5.0 * (1 + 1e-9)


def test_what_was_flown_counts_when_views_are_shared(targets):
    even = FleetPlan(targets, 8, fleet(0, 0)).tours
    uneven = FleetPlan(targets, 8, fleet(0, 0, flown=(6.0, 0.0))).tours
    assert sum(len(tour.views) for tour in even) == sum(len(tour.views) for tour in uneven) == 8
    assert uneven[0].length < even[0].length
    assert abs(6.0 + uneven[0].length - uneven[1].length) < 6.0


def test_a_plan_without_a_limit_is_that_of_one_vehicle(targets):
    plan = FleetPlan(targets, 6, fleet(0, 180))
    best = plan_views(targets.variance, 6, targets.admissible)
    assert plan.variance_after == pytest.approx(best.variance_after)


def test_the_first_stop_of_the_tour_is_the_best_to_go_to(targets):
    plan = FleetPlan(targets, 6, fleet(0, distance=7.0))
    (tour,) = plan.tours
    ends, travel = plan.ends()
    first = tour.views[0]
    assert ends[first] == pytest.approx(plan.variance_after)
    assert travel[first] == pytest.approx(tour.length)
    assert ends[first] <= ends.min() + 1e-3
    as_good = np.isclose(ends, ends[first], rtol=0, atol=1e-9)
    assert travel[first] == pytest.approx(travel[as_good].min())


def test_ends_are_those_of_ways_within_the_distance(targets):
    """Each is the variance after the candidate and a part of the tour, whose length is known."""
    distance = 5.0
    plan = FleetPlan(targets, 5, fleet(0, distance=distance))
    (tour,) = plan.tours
    here = view(0).centre
    ends, travel = plan.ends()
    for index in range(len(targets.later)):
        if np.linalg.norm(targets.centres[index] - here) > distance:
            assert ends[index] == np.inf
            continue
        assert travel[index] <= distance * (1 + 1e-9)
        if index in tour.views:
            continue
        fitting = [
            [index, *tour.views[:count]]
            for count in range(5)
            if way_length(targets, here, [index, *tour.views[:count]]) <= distance
        ]
        assert ends[index] == pytest.approx(targets.variance.variance_after(fitting[-1]))
        assert travel[index] == pytest.approx(way_length(targets, here, fitting[-1]))


def test_candidates_beyond_the_distance_have_no_end(targets):
    plan = FleetPlan(targets, 5, fleet(0, distance=0.6))
    ends, travel = plan.ends()
    assert np.flatnonzero(np.isfinite(ends)).tolist() == [0, len(ends) - 1]  # the neighbours of 0°
    assert (travel[np.isinf(ends)] == 0).all()
    nothing = FleetPlan(targets, 5, fleet(0, flown=(0.5,), distance=0.6))
    assert nothing.tours[0].views == ()
    assert nothing.variance_after == targets.variance.variance
    assert np.isinf(nothing.ends()[0]).all()


def test_a_view_of_another_vehicle_s_tour_gains_nothing_more(targets):
    plan = FleetPlan(targets, 6, fleet(0, 180))
    own, other = plan.tours
    ends, travel = plan.ends()
    for index in other.views:
        assert ends[index] == pytest.approx(plan.variance_after)
        assert travel[index] > travel[own.views[0]]


def test_a_vehicle_to_which_the_plan_gives_nothing_is_planned_for_alone(targets):
    """One view is left, and the other vehicle has flown less: the first flies all the same."""
    plan = FleetPlan(targets, 1, fleet(0, 180, flown=(9.0, 0.0)))
    assert [len(tour.views) for tour in plan.tours] == [0, 1]
    ends, _ = plan.ends()
    alone = FleetPlan(targets, 1, fleet(0)).ends()[0]
    np.testing.assert_allclose(ends, alone)


def test_only_what_can_be_registered_now_has_an_end(targets, monkeypatch):
    near = np.zeros(len(targets.later), dtype=bool)
    near[:5] = True

    def admissible(plan) -> np.ndarray:
        return near if not len(plan) else np.ones(len(near), dtype=bool)

    monkeypatch.setattr(targets, "admissible", admissible)
    ends, _ = FleetPlan(targets, 5, fleet(0, distance=7.0)).ends()
    assert np.isfinite(ends[near]).all()
    assert np.isinf(ends[~near]).all()
