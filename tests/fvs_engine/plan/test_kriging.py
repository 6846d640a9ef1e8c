"""The kriging variance against the formulas of Gaussian processes, written out."""

from dataclasses import replace

import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.plan import kriging
from fvs_engine.plan.kriging import NOISE, TargetVariance, covariance, noise_of, variances
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import View, with_share


def points(count: int, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 6))


def by_hand(targets: np.ndarray, observed: np.ndarray) -> np.ndarray:
    """1 − k (K + σ²)⁻¹ kᵀ for each target."""
    between = np.exp(-np.linalg.norm(targets[:, None] - observed[None], axis=-1))
    among = np.exp(-np.linalg.norm(observed[:, None] - observed[None], axis=-1))
    weights = np.linalg.inv(among + NOISE * np.eye(len(observed)))
    return 1.0 - np.einsum("to,op,tp->t", between, weights, between)


def test_variances_are_those_of_a_gaussian_process():
    targets, visited = points(7), points(4, seed=1)
    np.testing.assert_allclose(variances(targets, visited), by_hand(targets, visited), atol=1e-12)
    np.testing.assert_allclose(variances(targets, np.zeros((0, 6))), 1.0)


def test_variances_of_many_poses_are_computed_in_parts(monkeypatch: pytest.MonkeyPatch):
    targets, visited = points(23), points(4, seed=1)
    monkeypatch.setattr(kriging, "_AT_ONCE", 20)
    np.testing.assert_allclose(variances(targets, visited), by_hand(targets, visited), atol=1e-12)


def test_a_masked_view_is_an_observation_of_as_many_pixels_as_count():
    targets, visited = points(7), points(3, seed=1)
    camera = PinholeCamera(8, 4, 8.0, 8.0, 4.0, 2.0)
    whole = View("whole", camera, RigidTransform.identity())
    image, mask = np.zeros((4, 8, 3), np.uint8), np.arange(32).reshape(4, 8) < 8
    quarter = TrainingView("quarter", camera, whole.camera_from_model, image, mask)
    nothing = replace(quarter, mask=mask & False)
    noise = noise_of([whole, quarter, nothing])
    assert noise[:2].tolist() == [NOISE, 4 * NOISE]
    assert noise_of([with_share(quarter, quarter.counted_share)]) == [4 * NOISE]

    # Four photographs of a place are one whole one of which each shows a quarter.
    once, four = visited[:1], np.repeat(visited[:1], 4, axis=0)
    np.testing.assert_allclose(
        variances(targets, four, np.full(4, 4 * NOISE)), variances(targets, once), atol=1e-12
    )
    without = variances(targets, visited[:2], noise[:2])
    np.testing.assert_allclose(variances(targets, visited, noise), without, atol=1e-2)
    variance = TargetVariance(targets, points(5, seed=2), visited[:2], noise=noise[:2])
    assert variance.variance == pytest.approx(without.mean())
    assert variance.variance > TargetVariance(targets, points(5, seed=2), visited[:2]).variance


@pytest.mark.parametrize("visited_count", [0, 1, 5])
@pytest.mark.parametrize("plan", [(), (3,), (3, 0), (8, 2, 5, 1)])
def test_gains_are_what_a_view_takes_from_the_mean_variance(visited_count, plan):
    targets, candidates, visited = points(12), points(9, seed=1), points(visited_count, seed=2)
    weights = np.linspace(0.0, 2.0, 12)
    variance = TargetVariance(targets, candidates, visited, weights)
    before = np.concatenate([visited, candidates[list(plan)]])
    mean = np.average(by_hand(targets, before), weights=weights)
    assert variance.variance_after(plan) == pytest.approx(mean, abs=1e-12)
    expected = [
        mean - np.average(by_hand(targets, np.concatenate([before, candidate[None]])), weights=weights)
        for candidate in candidates
    ]
    np.testing.assert_allclose(variance.gains(plan), expected, atol=1e-12)
    some = np.array([4, 1])
    np.testing.assert_allclose(variance.gains(plan, some), np.array(expected)[some], atol=1e-12)


def test_a_view_that_is_visited_again_gains_little_and_coinciding_views_are_no_error():
    targets = points(5)
    same = np.repeat(targets[:1], 6, axis=0)
    variance = TargetVariance(targets, same, same)
    assert np.all(variance.gains([0, 1, 2]) < 0.01)
    assert np.all(variance.gains([]) >= 0)


def test_of_many_targets_an_even_share_stands_for_all():
    many, candidates = points(30_000), points(50, seed=1)
    whole = by_hand(many, candidates[:3]).mean()
    variance = TargetVariance(many, candidates, np.zeros((0, 6)))
    assert len(variance.target_variances) == 1_000
    assert variance.variance_after([0, 1, 2]) == pytest.approx(whole, rel=0.01)


def test_many_candidates_are_held_in_bounded_memory(monkeypatch):
    monkeypatch.setattr(kriging, "_MOST_PRODUCTS", 4_000_000)
    variance = TargetVariance(points(500), points(20_000, seed=1), points(3, seed=2))
    assert len(variance.target_variances) == 200
    assert variance.gains([19_999, 0]).shape == (20_000,)


def test_targets_are_needed_and_their_weights_must_fit():
    with pytest.raises(InvalidInputError, match="no target"):
        TargetVariance(np.zeros((0, 6)), points(2), points(1))
    for weights in (np.ones(2), -np.ones(3), np.full(3, np.nan)):
        with pytest.raises(InvalidInputError, match="one weight each"):
            TargetVariance(points(3), points(2), points(1), weights)
    with pytest.raises(InvalidInputError, match="weight of 0"):
        TargetVariance(points(3), points(2), points(1), np.zeros(3))


def test_the_covariance_falls_with_the_distance():
    far = covariance(points(1), points(1) + np.array([[0, 0, 0, 2.0, 0, 0]]))
    assert float(far[0, 0]) == pytest.approx(np.exp(-2.0))
