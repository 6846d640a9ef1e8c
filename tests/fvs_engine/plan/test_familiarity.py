"""Familiarity of views with the sparse points."""

import numpy as np
import pytest

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.plan.familiarity import ENOUGH, Familiarity, Observations
from fvs_engine.views import PinholeView

CAMERA = PinholeCamera(64, 48, 60.0, 60.0, 32.0, 24.0)


def at(degrees: float, distance: float = 5.0) -> PinholeView:
    """A view of the origin from a ring around it."""
    angle = np.radians(degrees)
    centre = (distance * np.cos(angle), distance * np.sin(angle), 0.0)
    return PinholeView(str(degrees), CAMERA, look_at(centre, (0, 0, 0), (0.0, 0.0, 1.0)).inverse())


def seen_from(*degrees: float, count: int = 100) -> Observations:
    """``count`` points around the origin, each seen from these places."""
    points = 0.1 * np.random.default_rng(0).normal(size=(count, 3))
    numbers = np.tile(np.arange(count), len(degrees))
    centres = np.repeat([at(angle).centre for angle in degrees], count, axis=0).reshape(-1, 3)
    return Observations(points, numbers, centres)


def test_familiar_points_fall_with_the_angle_to_the_nearest_camera_that_saw_them():
    familiarity = Familiarity(seen_from(0.0, 90.0), [at(0.0), at(15.0), at(70.0), at(45.0), at(180.0)])
    expected = [100.0, 100 / np.e, 100 * np.exp(-((20 / 15) ** 2)), 100 * np.exp(-9.0), 0.0]
    np.testing.assert_allclose(familiarity.counts, expected, rtol=0.02, atol=0.01)
    chances = familiarity.probability()
    assert np.all(np.diff(chances[[0, 1, 2, 3, 4]]) <= 0)
    assert chances[0] > 0.8
    assert chances[-1] < 0.01


def test_points_behind_the_camera_and_outside_of_its_frame_do_not_count():
    away = PinholeView("away", CAMERA, look_at((5, 0, 0), (10, 0, 0), (0.0, 0.0, 1.0)).inverse())
    assert Familiarity(seen_from(0.0), [away]).counts[0] == 0


def test_points_seen_from_afar_are_not_familiar_from_nearby():
    familiarity = Familiarity(seen_from(0.0), [at(0.0, 4.0), at(0.0, 2.0), at(0.0, 9.0), at(0.0, 11.0)])
    assert (familiarity.counts > 90).tolist() == [True, False, True, False]


def test_a_planned_view_is_a_bridge_to_those_beyond_it_if_it_can_be_registered_itself():
    familiarity = Familiarity(seen_from(0.0, count=400), [at(12.0), at(24.0), at(50.0), at(120.0)])
    assert familiarity.enough().tolist() == [True, False, False, False]
    assert familiarity.enough([0]).tolist() == [True, True, False, False]
    assert familiarity.enough([1]).tolist() == [True, False, False, False]  # itself unknown
    assert familiarity.enough([1, 0])[1]


def test_where_nothing_is_familiar_enough_the_most_familiar_is_left():
    familiarity = Familiarity(seen_from(0.0), [at(60.0), at(30.0), at(90.0)])
    assert familiarity.counts.max() < 30
    assert familiarity.enough().tolist() == [False, True, False]


def test_in_a_scene_of_few_points_views_that_are_nearly_as_familiar_as_any_are_enough():
    familiarity = Familiarity(seen_from(0.0, count=50), [at(2.0), at(8.0), at(20.0)])
    assert 30 < familiarity.counts[1] < familiarity.counts[0] < ENOUGH
    assert familiarity.enough().tolist() == [True, True, False]


def test_of_many_points_an_even_share_stands_for_all():
    many = Familiarity(seen_from(0.0, 20.0, count=20_000), [at(5.0), at(30.0)])
    few = Familiarity(seen_from(0.0, 20.0, count=4_000), [at(5.0), at(30.0)])
    assert many.counts == pytest.approx(5 * few.counts, rel=0.05)


def test_without_candidates_or_points_nothing_is_familiar():
    assert Familiarity(seen_from(0.0), []).enough().tolist() == []
    nothing = Observations(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros((0, 3)))
    assert Familiarity(nothing, [at(0.0)]).counts.tolist() == [0.0]


def test_bridges_are_the_same_in_parts(monkeypatch):
    candidates = [at(float(angle)) for angle in range(12, 120, 4)]
    whole = Familiarity(seen_from(0.0, count=400), candidates).enough([0, 1, 2])
    monkeypatch.setattr("fvs_engine.plan.familiarity._AT_ONCE", 500)
    parts = Familiarity(seen_from(0.0, count=400), candidates).enough([0, 1, 2])
    assert whole.sum() > 2
    assert parts.tolist() == whole.tolist()
