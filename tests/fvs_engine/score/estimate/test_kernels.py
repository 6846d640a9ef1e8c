"""The kernels of the estimate, held to the same formulas written plainly."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F
from fvs_engine.score.estimate.cells import CELL_VARIANCE, LEAST_SEEN, MOST_SMALL, SIGMAS, cover
from fvs_engine.score.estimate.powers import EVENNESS, SPACING, sum_powers
from fvs_engine.score.estimate.projection import BINS, DEPTH, REACH, RECORD_SIZE, XX, XY, YY, front_to_back
from fvs_engine.score.estimate.spectrum import GRID
from fvs_engine.splat.conventions import ALPHA_MAX, ALPHA_MIN, CENTER_X, CENTER_Y, OPACITY, RED

Floats = NDArray[np.float64]

SIZE = (300, 170)
SIDE = 16.0


def _splats(count: int, deviations: tuple[float, float], seed: int = 3) -> NDArray[np.float32]:
    """Splats in and around an image, whose standard deviations in px lie between two, at random depths."""
    draw = np.random.default_rng(seed)
    splats = np.empty((count, RECORD_SIZE))
    splats[:, CENTER_X], splats[:, CENTER_Y] = draw.uniform(-40, 340, count), draw.uniform(-40, 210, count)
    long, short = np.exp(draw.uniform(*np.log(deviations), (2, count)))
    angle = draw.uniform(0, np.pi, count)
    splats[:, XX] = (long * np.cos(angle)) ** 2 + (short * np.sin(angle)) ** 2 + 0.3
    splats[:, YY] = (long * np.sin(angle)) ** 2 + (short * np.cos(angle)) ** 2 + 0.3
    splats[:, XY] = (long**2 - short**2) * np.sin(angle) * np.cos(angle)
    splats[:, OPACITY] = draw.uniform(0.02, 0.99, count)
    splats[:, RED : RED + 3] = draw.uniform(0, 1, (count, 3))
    splats[:, DEPTH] = draw.uniform(0.5, 40, count)
    splats[:, REACH] = np.sqrt(2 * np.log(splats[:, OPACITY] / ALPHA_MIN))
    return splats.astype(np.float32)


def _blended(splats: Floats, rows: int, columns: int) -> tuple[Floats, Floats]:
    """The cells [4, rows, columns] without a border, and how much is seen."""
    y, x = (np.mgrid[0:rows, 0:columns] + 0.5) * SIDE
    cells = np.concatenate([np.ones((1, rows, columns)), np.zeros((3, rows, columns))])
    seen = np.zeros(len(splats))
    wider = float(CELL_VARIANCE) * SIDE**2 * np.eye(2)
    for n, splat in enumerate(splats):
        own = np.array([[splat[XX], splat[XY]], [splat[XY], splat[YY]]])
        away = np.stack([x - splat[CENTER_X], y - splat[CENTER_Y]])
        square = np.einsum("irc,ij,jrc->rc", away, np.linalg.inv(own + wider), away)
        summit = splat[OPACITY] * math.sqrt(np.linalg.det(own) / np.linalg.det(own + wider))
        alpha = np.minimum(summit * np.exp(-0.5 * square), ALPHA_MAX) * (square < float(SIGMAS) ** 2)
        row, column = int(splat[CENTER_Y] // SIDE), int(splat[CENTER_X] // SIDE)
        if (
            max(splat[XX], splat[YY]) < float(MOST_SMALL) * SIDE**2
            and 0 <= row < rows
            and 0 <= column < columns
        ):
            alpha = np.zeros((rows, columns))
            covered = splat[OPACITY] * 2 * math.pi * math.sqrt(np.linalg.det(own)) / SIDE**2
            alpha[row, column] = min(covered, ALPHA_MAX)
        weight = alpha * cells[0]
        seen[n] = weight.sum() / max(alpha.sum(), 1e-12)
        cells[0] -= weight
        cells[1:] += weight * splat[RED : RED + 3, None, None]
    return cells, seen


@pytest.mark.parametrize("deviations", [(0.5, 8.0), (0.5, 60.0)])
def test_splats_of_any_size_are_blended_into_cells(deviations):
    splats = _splats(300, deviations)
    seen = np.empty(len(splats), np.float32)
    cells = cover(splats, SIZE, F(SIDE), seen)
    expected, expected_seen = _blended(splats.astype(np.float64), 11, 19)
    np.testing.assert_allclose(cells, expected, atol=2 * LEAST_SEEN)
    within = (splats[:, CENTER_X] > 30) & (splats[:, CENTER_X] < 270)
    within &= (splats[:, CENTER_Y] > 30) & (splats[:, CENTER_Y] < 140)  # elsewhere the border is seen, too
    small = within & (np.maximum(splats[:, XX], splats[:, YY]) < 100)
    assert small.sum() > 20
    np.testing.assert_allclose(seen[small], expected_seen[small], atol=2 * LEAST_SEEN)


def test_huge_thin_splats_leave_numbers():
    splats = _splats(50, (1.0, 8.0))
    splats[::2, [XX, XY, YY]] = np.float32([4e12, 4e12, 4e12])
    seen = np.empty(len(splats), np.float32)
    cells = cover(splats, SIZE, F(SIDE), seen)
    assert np.isfinite(cells).all()
    assert np.isfinite(seen).all()


def test_powers_are_those_of_gaussians_around_the_frequencies():
    """Each is the mean around its frequency, and more where many splats share in it."""
    splats = _splats(200, (0.3, 5.0))
    splats[:, CENTER_X] = np.clip(splats[:, CENTER_X], 40, 260)  # away from the borders
    splats[:, CENTER_Y] = np.clip(splats[:, CENTER_Y], 40, 130)
    draw = np.random.default_rng(0)
    seen = draw.uniform(0, 1, len(splats)).astype(np.float32)
    cells = draw.uniform(0, 1, (4, 11, 19)).astype(np.float32)
    inside, across_x, across_y, steps = sum_powers(splats, cells, F(SIDE), seen, SIZE, GRID)
    offsets, weights = np.polynomial.hermite_e.hermegauss(24)
    around = math.sqrt(SPACING**2 / 12) * np.stack(np.meshgrid(offsets, offsets), -1).reshape(-1, 2)
    shares = np.outer(weights, weights).ravel() / weights.sum() ** 2
    powers, edges = np.zeros((len(splats), 3, 32)), np.zeros(3)
    for n, (splat, share) in enumerate(zip(splats.astype(np.float64), seen, strict=True)):
        covariance = np.array([[splat[XX], splat[XY]], [splat[XY], splat[YY]]])
        row, column = int(splat[CENTER_Y] / SIDE), int(splat[CENTER_X] / SIDE)
        contrast = (share * (splat[RED : RED + 3] - cells[1:, row, column])) ** 2
        determinant = np.linalg.det(covariance)
        frequencies = GRID[:, None, :] + around
        exponents = 4 * np.pi**2 * np.einsum("fsi,ij,fsj->fs", frequencies, covariance, frequencies)
        body = 4 * np.pi**2 * determinant * splat[OPACITY] ** 2 * (np.exp(-exponents) @ shares)
        powers[n] = contrast[:, None] * body
        edges += contrast * ALPHA_MIN**2 * splat[REACH] * determinant**0.25
    total = powers.sum((0, 1))
    expected = powers.sum(0) * (total**2 / (powers.sum(1) ** 2).sum(0)) ** EVENNESS
    np.testing.assert_allclose(inside, expected, rtol=5e-3)
    np.testing.assert_allclose(steps, edges, rtol=1e-3)
    assert not across_x.any()
    assert not across_y.any()


def test_splats_are_put_in_order_of_depth_and_equal_ones_stay():
    splats = _splats(5_000, (1.0, 2.0))
    splats[100:200, DEPTH] = 3.0
    splats[:, CENTER_X] = np.arange(5_000)
    depths, places = front_to_back(splats)[:, [DEPTH, CENTER_X]].T
    assert sorted(places) == list(range(5_000))
    steps = np.diff(depths) / depths[1:]
    assert steps.min() > -2 * np.log(80) / BINS * 2  # as near as bins tell them apart
    equal = places[depths == 3.0]
    assert (np.diff(equal) > 0).all()
    assert len(front_to_back(splats[:0])) == 0
    assert (front_to_back(splats[100:200])[:, CENTER_X] == np.arange(100, 200)).all()
