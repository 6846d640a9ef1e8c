import numpy as np
import pytest

from fvs_engine.score.regression import predict


@pytest.fixture
def line():
    """Sixty poses in a row, and estimates that wander along it."""
    points = np.linspace(0, 6, 60)[:, None]
    return points, np.sin(points[:, 0]) + np.random.default_rng(0).normal(0, 0.3, 60)


def test_a_linear_function_of_the_estimate_is_found(line):
    points, estimates = line
    scores = 0.4 + 1.7 * estimates
    measured = np.arange(0, 60, 5)
    found = predict(estimates, points, measured, scores[measured])
    np.testing.assert_allclose(found.means, scores, atol=1e-6)


def test_errors_are_shared_by_views_nearby(line):
    """The score is higher than the estimates say on one half of the row."""
    points, estimates = line
    scores = estimates + 1.0 * (points[:, 0] > 3)
    measured = np.arange(0, 60, 4)
    found = predict(estimates, points, measured, scores[measured])
    left = np.setdiff1d(np.arange(60), measured)
    line_only = np.polyval(np.polyfit(estimates[measured], scores[measured], 1), estimates)
    by_kriging = np.abs(found.means - scores)[left].mean()
    assert by_kriging < 0.5 * np.abs(line_only - scores)[left].mean()


def test_predictions_are_less_sure_far_from_what_was_measured():
    points = np.linspace(0, 10, 40)[:, None]
    draw = np.random.default_rng(1)
    estimates = draw.normal(size=40)
    scores = estimates + np.cumsum(draw.normal(0, 0.3, 40))
    found = predict(estimates, points, np.arange(12), scores[:12])
    assert found.deviations[39] > found.deviations[12]


def test_deviations_hold():
    """Of errors drawn as the model assumes, about 80 % are within 1.28 deviations."""
    draw = np.random.default_rng(2)
    held = []
    for _ in range(40):
        points = draw.uniform(0, 8, (80, 1))
        covariance = np.exp(-np.abs(points - points.T)) + 0.1 * np.eye(80)
        estimates = draw.normal(size=80)
        scores = 2.0 + estimates + 0.5 * np.linalg.cholesky(covariance) @ draw.normal(size=80)
        found = predict(estimates, points, np.arange(24), scores[:24])
        held.append(np.abs(found.means - scores)[24:] < 1.2816 * found.deviations[24:])
    assert 0.74 < np.mean(held) < 0.86


def test_equal_estimates_predict_the_mean():
    points = np.random.default_rng(3).normal(size=(20, 3))
    scores = np.random.default_rng(4).normal(5.0, 0.1, 20)
    found = predict(np.ones(20), points, np.arange(8), scores[:8])
    np.testing.assert_allclose(found.means, 5.0, atol=0.5)
    assert np.isfinite(found.deviations).all()
