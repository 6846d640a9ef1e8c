"""Kriging variance: how well the poses that a model must serve are surrounded by visited ones.

Source: kriging, also called Gaussian process regression (Krige 1951; Rasmussen and Williams, "Gaussian
Processes for Machine Learning", 2006, chapter 2). Over 54 trained models of Mip-NeRF360 *bonsai* the variance
of a pose predicts the PSNR of its render with a correlation of 0.8; what renders show predicts less.
"""

from collections.abc import Sequence
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from fvs_engine.errors import InvalidInputError
from fvs_engine.plan.distances import distances_between, even_sample
from fvs_engine.views import AnyView

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

LENGTH = 1.0
"""Distance of views (``view_points``) over which their covariance falls to 1/e."""
NOISE = 1.0
"""Variance of one observation: as large as the prior's, for one photograph alone tells little of a pose.

PSNR follows the variance more closely than with 0.1 (docs/design/planning.md)."""
_LEAST_SHARE = 1e-3
_MOST_TARGETS = 1_000
_MOST_PRODUCTS = 20_000_000
"""Maximum size of the matrix of targets × candidates: 160 MB."""
_AT_ONCE = 1_000_000
"""Maximum size of a matrix of poses × visited ones: 8 MB."""


class TargetVariance:
    """The mean kriging variance over targets, and by how much views at candidates' poses would lower it.

    Poses a and b covary by exp(−d(a, b) / ``LENGTH``), and an observation has the variance ``NOISE``. Poses
    are points [·, 6] of ``view_points``; ``noise`` [V] is that of the ``visited`` ones (``noise_of``; None:
    ``NOISE``); ``weights`` [T] of targets default to equal ones, and are scaled to
    a sum of 1. Of very many targets an even share is used, so that memory is bounded.

    A plan is a sequence of indices of candidates. Adding any candidate to one costs products of the size of
    the plan: everything else is computed once (``gains``). Raises ``InvalidInputError`` without targets.
    """

    def __init__(
        self,
        targets: Array,
        candidates: Array,
        visited: Array,
        weights: Array | None = None,
        *,
        noise: Array | None = None,
    ) -> None:
        if not len(targets):
            raise InvalidInputError("There is no target to plan for.", hint="Give the poses to be served.")
        shares = np.ones(len(targets)) if weights is None else np.asarray(weights, dtype=np.float64)
        if shares.shape != (len(targets),) or not np.isfinite(shares).all() or (shares < 0).any():
            raise InvalidInputError("Targets need one weight each, of at least 0.")
        if shares.sum() == 0:
            raise InvalidInputError("All targets have a weight of 0.", hint="Give one of them more.")
        self._used = used = even_sample(
            len(targets), min(_MOST_TARGETS, _MOST_PRODUCTS // max(1, len(candidates)))
        )
        targets, shares = targets[used], shares[used]
        roots = np.sqrt(shares / shares.sum())
        self._candidates = candidates
        self._visited = visited
        factor = _factor(visited, noise)
        # Rows of visited views, whitened: the covariance given them is the prior less their products.
        of_targets = _solve(factor, covariance(visited, targets))
        self._of_candidates = _solve(factor, covariance(visited, candidates))
        self.target_variances = 1.0 - (of_targets**2).sum(axis=0)
        """The variance of every target used, before the plan."""
        self.variance = float((roots**2) @ self.target_variances)
        """The mean over targets before the plan, in [0, 1]."""
        self._shared = roots[:, None] * (covariance(targets, candidates) - of_targets.T @ self._of_candidates)
        self._own = 1.0 - (self._of_candidates**2).sum(axis=0)
        self._squares = np.einsum("tc,tc->c", self._shared, self._shared)
        self._row = cache(self._uncached_row)

    def gains(self, plan: Sequence[int], among: Indices | None = None) -> Array:
        """By how much each candidate (of those ``among``) would lower the mean variance after ``plan``."""
        kept = slice(None) if among is None else among
        squares, own = self._squares[kept], self._own[kept]
        if len(plan):
            chosen = list(plan)
            between, products = self._rows(plan)
            observed = between[:, chosen] + NOISE * np.eye(len(chosen))
            covariances = between[:, kept]
            weights = np.linalg.solve(observed, covariances)
            squares = (
                squares
                - 2 * (weights * products[:, kept]).sum(axis=0)
                + (weights * (products[:, chosen] @ weights)).sum(axis=0)
            )
            own = own - (covariances * weights).sum(axis=0)
        return np.asarray(np.maximum(squares, 0.0) / (np.maximum(own, 0.0) + NOISE))

    def helped(self, index: int, count: int) -> tuple[int, ...]:
        """Indices of the ``count`` targets whose variance a candidate lowers most, in descending order."""
        order = np.argsort(-np.abs(self._shared[:, index]), kind="stable")[:count]
        return tuple(self._used[order].tolist())

    def variance_after(self, plan: Sequence[int]) -> float:
        """The mean variance over targets once the views of ``plan`` were visited."""
        if not len(plan):
            return self.variance
        between, products = self._rows(plan)
        chosen = list(plan)
        precision = np.linalg.inv(between[:, chosen] + NOISE * np.eye(len(chosen)))
        return float(self.variance - (precision * products[:, chosen]).sum())

    def _rows(self, plan: Sequence[int]) -> tuple[Array, Array]:
        """Planned views' covariances with candidates, and the products over targets, [m, n] each."""
        between, products = zip(*(self._row(index) for index in plan), strict=True)
        return np.stack(between), np.stack(products)

    def _uncached_row(self, index: int) -> tuple[Array, Array]:
        prior = covariance(self._candidates[index : index + 1], self._candidates)[0]
        between = prior - self._of_candidates[:, index] @ self._of_candidates
        return np.asarray(between), np.asarray(self._shared[:, index] @ self._shared)


def covariance(points: Array, others: Array) -> Array:
    """Prior covariances [len(points), len(others)] of poses, 1 where they are the same."""
    return np.asarray(np.exp(-distances_between(points, others) / LENGTH))


def noise_of(views: Sequence[AnyView]) -> Array:
    """The variance of the observation at each of the visited ``views`` [V].

    That of a mean over pixels: of a masked photograph it is ``NOISE`` over the share that counts.
    """
    shares = np.array([view.counted_share for view in views], dtype=np.float64)
    return NOISE / np.maximum(shares, _LEAST_SHARE)


def variances(points: Array, visited: Array, noise: Array | None = None) -> Array:
    """The kriging variance [P] of poses ``points`` given ``visited`` ones; 1 without any.

    ``noise`` [V] is that of the visited ones (None: ``NOISE``).
    """
    factor, found = _factor(visited, noise), np.empty(len(points))
    size = max(1, _AT_ONCE // max(1, len(visited)))
    for start in range(0, len(points), size):
        part = slice(start, start + size)
        found[part] = 1.0 - (_solve(factor, covariance(visited, points[part])) ** 2).sum(axis=0)
    return found


def _factor(visited: Array, noise: Array | None) -> Array:
    """The Cholesky factor of the covariances of observations."""
    observed = covariance(visited, visited)
    observed[np.diag_indices(len(visited))] += NOISE if noise is None else noise
    return np.asarray(np.linalg.cholesky(observed), dtype=np.float64)


def _solve(factor: Array, right: Array) -> Array:
    """``factor``⁻¹ ``right`` for a lower triangle."""
    return np.asarray(solve_triangular(factor, right, lower=True)) if len(factor) else right
