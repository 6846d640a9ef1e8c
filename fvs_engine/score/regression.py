"""Predicts exact scores from estimates, and from the exact scores of views nearby."""

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_factor, cho_solve

from fvs_engine.plan.distances import distances_between

Floats = NDArray[np.float64]

LENGTHS = (0.3, 1.0, 3.0)
"""Candidate correlation lengths of the errors of estimates, in distances of views."""
NOISES = (0.01, 0.1, 0.5)
"""Candidate variances of the independent part of an error, as shares of the correlated part."""


@dataclass(frozen=True)
class Prediction:
    """Expected scores [N], and their standard deviations [N]."""

    means: Floats
    deviations: Floats


def predict(estimates: Floats, points: Floats, measured: NDArray[np.int64], scores: Floats) -> Prediction:
    """Predict the exact scores of all N views from the ``scores`` [M] of the ``measured`` ones (M ≥ 4).

    ``estimates`` [N] and ``points`` [N, D], the poses (``view_points``). A score is a linear function of its
    estimate, plus an error that covaries as exp(−distance / length) between views, plus one of its own:
    universal kriging. Length and share of the latter are those of the greatest restricted likelihood. With
    equal estimates their mean replaces the line.
    """
    spread = estimates[measured].std()
    trend = np.stack(
        [np.ones(len(estimates)), (estimates - estimates[measured].mean()) / max(spread, 1e-12)], 1
    )
    if spread < 1e-9:
        trend = trend[:, :1]
    between = distances_between(points[measured], points[measured])
    to_all = distances_between(points, points[measured])
    fits = (_fit(trend[measured], between, scores, *shape) for shape in product(LENGTHS, NOISES))
    return max(fits, key=lambda fit: fit.likelihood).predict(trend, to_all)


@dataclass(frozen=True)
class _Fit:
    likelihood: float
    length: float
    noise: float
    variance: float
    coefficients: Floats
    trend: Floats
    factor: tuple[Floats, bool]
    residual_weights: Floats

    def predict(self, trend: Floats, distances: Floats) -> Prediction:
        """At views with ``trend`` [N, P], at ``distances`` [N, M] from the measured ones."""
        covariances = np.exp(-distances / self.length)
        means = trend @ self.coefficients + covariances @ self.residual_weights
        weights = cho_solve(self.factor, covariances.T)
        explained = np.einsum("nm,mn->n", covariances, weights)
        apart = trend.T - self.trend.T @ weights
        information = self.trend.T @ cho_solve(self.factor, self.trend)
        unsure = np.einsum("pn,pn->n", apart, np.linalg.solve(information, apart))
        variances = self.variance * (1.0 + self.noise - explained + unsure)
        return Prediction(means, np.sqrt(np.maximum(variances, 1e-18)))


def _fit(trend: Floats, between: Floats, scores: Floats, length: float, noise: float) -> _Fit:
    """Generalised least squares for one shape of the covariance."""
    free = len(scores) - trend.shape[1]
    covariance = np.exp(-between / length) + noise * np.eye(len(scores))
    factor = cho_factor(covariance, lower=True)
    information = trend.T @ cho_solve(factor, trend)
    coefficients = np.linalg.solve(information, trend.T @ cho_solve(factor, scores))
    residuals = scores - trend @ coefficients
    weights = cho_solve(factor, residuals)
    variance = max(float(residuals @ weights) / free, 1e-18)
    log_determinant = 2.0 * np.log(np.diag(factor[0])).sum() + np.linalg.slogdet(information)[1]
    likelihood = -0.5 * (log_determinant + free * np.log(variance))
    return _Fit(likelihood, length, noise, variance, coefficients, trend, factor, weights)
