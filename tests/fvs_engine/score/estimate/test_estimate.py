"""Estimates without a render, held to renders."""

import math
from dataclasses import replace
from itertools import product

import numpy as np
import pytest
import torch
from scipy.spatial import KDTree
from scipy.stats import spearmanr

from fvs_engine.compilation.kernels import F
from fvs_engine.errors import Cancelled, InvalidInputError
from fvs_engine.geometry import PinholeCamera, RigidTransform, look_at
from fvs_engine.monitor import Monitor
from fvs_engine.score import MedianFrequency, MedianFrequencyEstimate
from fvs_engine.score.estimate.cells import cover
from fvs_engine.score.estimate.powers import SPACING, median_log_magnitude
from fvs_engine.score.estimate.projection import BLOCK
from fvs_engine.score.estimate.spectrum import GRID, expected_powers
from fvs_engine.score.estimate.splat_table import SplatTable
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.raster.reference_projection import project
from fvs_engine.views import PinholeView
from fvs_schema.candidates import CandidateStatus

CAMERA = PinholeCamera(128, 96, 110.0, 110.0, 64.0, 48.0)


@pytest.fixture
def cluttered() -> tuple[Gaussians, list[PinholeView]]:
    """A wall of splats, coarse on the left and fine on the right, and views along it from three distances."""
    draw = np.random.default_rng(5)
    count = 6_000
    means = np.stack([draw.uniform(-6, 6, count), draw.uniform(-3, 3, count), draw.normal(0, 0.2, count)], 1)
    sizes = 0.02 + 0.18 * (means[:, :1] < 0) + draw.uniform(0, 0.02, (count, 3))
    values = (
        means,
        np.log(sizes),
        draw.normal(size=(count, 4)),
        draw.normal(1.0, 1.0, count),
        draw.normal(scale=0.5, size=(count, 3)),
        np.zeros((count, 0, 3)),
    )
    tensors = [torch.from_numpy(value.astype(np.float32)) for value in values]
    views = [
        PinholeView(f"{n:02}", CAMERA, look_at([x, 0.3, -z], [x, 0.0, 0.0], [0.0, 1.0, 0.0]).inverse())
        for n, (x, z) in enumerate((x, z) for z in (2.0, 3.0, 4.5) for x in np.linspace(-4, 4, 12))
    ]
    return Gaussians(*tensors), views


def _one(
    log_scales: tuple[float, float, float], opacity: float, mean: tuple[float, float, float]
) -> Gaussians:
    return Gaussians(
        means=torch.tensor([mean]),
        log_scales=torch.tensor([log_scales]),
        quaternions_wxyz=torch.tensor([[0.9, 0.1, 0.2, 0.4]]),
        opacity_logits=torch.tensor([math.log(opacity / (1 - opacity))]),
        sh_dc=torch.tensor([[1.0, 0.2, -0.5]]),
        sh_rest=torch.zeros(1, 0, 3),
    )


def _covered(gaussians: Gaussians, view: PinholeView) -> tuple[np.ndarray, ...]:
    """The splats front to back, the cells and how much is seen of each splat."""
    splats = SplatTable.of(gaussians).splats(view)
    seen = np.empty(len(splats), np.float32)
    return splats, cover(splats, (128, 96), F(16), seen), seen


def test_splats_are_projected_as_the_rasterisers_do(cluttered):
    gaussians, views = cluttered
    for view in views[::9]:
        splats = SplatTable.of(gaussians).splats(view)
        expected = project(gaussians, view.camera, view.camera_from_model, 0)
        shown = expected.visible
        a, k, b = (factor.numpy() for factor in expected.factors[shown].T)
        yy = 0.5 / b**2
        xx = 0.5 / a**2 + (k * yy) ** 2 / yy
        assert len(splats) == int(shown.sum())
        distances, nearest = KDTree(expected.centers[shown].numpy()).query(splats[:, :2])
        assert distances.max() < 2e-3
        np.testing.assert_allclose(splats[:, 2], xx[nearest], rtol=2e-3)
        np.testing.assert_allclose(splats[:, 3], (k * yy)[nearest], atol=2e-3 * xx.max())
        np.testing.assert_allclose(splats[:, 4], yy[nearest], rtol=2e-3)


def test_blocks_are_left_out_only_if_none_of_their_splats_touches_the_image():
    draw = torch.Generator().manual_seed(5)
    count = 20_000  # no multiple of a block
    gaussians = Gaussians(
        means=torch.randn((count, 3), generator=draw) * torch.tensor([6.0, 6.0, 2.0]),
        log_scales=torch.randn((count, 3), generator=draw) - 3.5,
        quaternions_wxyz=torch.randn((count, 4), generator=draw),
        opacity_logits=torch.randn(count, generator=draw),
        sh_dc=torch.randn((count, 3), generator=draw),
        sh_rest=torch.zeros(count, 0, 3),
    )
    gaussians.means[7] = torch.nan
    table = SplatTable.of(gaussians)
    everything = replace(table, bounds=np.full_like(table.bounds, np.inf))
    for target in ((0.0, 0.0, 0.0), (5.0, 1.0, 0.5), (-3.0, 4.0, -0.5)):
        view = PinholeView("view", CAMERA, look_at((3.0, -7.0, 1.0), target, (0.0, 0.0, 1.0)).inverse())
        np.testing.assert_array_equal(table.splats(view), everything.splats(view))
        assert len(table.splats(view)) < count / 2
    elsewhere = PinholeView(
        "view", CAMERA, look_at((0, 0, 40.0), (0.0, 0.0, 80.0), (0.0, 1.0, 0.0)).inverse()
    )
    assert len(table.splats(elsewhere)) == 0


def test_neighbours_in_a_model_are_neighbours_in_its_table():
    count = 128 * BLOCK
    table = SplatTable.of(
        Gaussians(
            means=torch.rand((count, 3), generator=torch.Generator().manual_seed(0)),
            log_scales=torch.full((count, 3), -4.0),
            quaternions_wxyz=torch.ones(count, 4),
            opacity_logits=torch.zeros(count),
            sh_dc=torch.zeros(count, 3),
            sh_rest=torch.zeros(count, 0, 3),
        )
    )
    assert table.bounds.shape == (5, 128)
    assert table.bounds[3].mean() < 0.4  # half the diagonal is 0.87 of the cube, 0.19 of a 128th of it


def test_the_power_of_one_splat_is_that_of_its_render():
    """In the middle of the image, small and steep: its body is all there is, but for the contrast's cell."""
    gaussians = _one((-3.9, -4.3, -3.6), 0.9, (0.11, -0.07, 3.0))
    view = PinholeView("one", CAMERA, RigidTransform.identity())
    splats, cells, seen = _covered(gaussians, view)
    black = 0.0 * cells  # not its own cell
    found = expected_powers(splats, black, F(16), seen, (128, 96))
    image = create_rasterizer("reference").render(gaussians, CAMERA, view.camera_from_model).color
    rows, columns = np.mgrid[0:96, 0:128]
    low = np.flatnonzero(np.hypot(*GRID.T) < 0.35)  # above, a splat as sharp as this one is aliased
    assert len(low) == 12
    offsets, weights = np.polynomial.hermite_e.hermegauss(3)  # powers are means around their frequencies
    offsets *= SPACING / math.sqrt(12)
    weights /= weights.sum()
    for j in low:
        power = np.zeros(3)
        for (dx, wx), (dy, wy) in product(zip(offsets, weights, strict=True), repeat=2):
            wave = np.exp(-2j * np.pi * ((GRID[j, 0] + dx) * columns + (GRID[j, 1] + dy) * rows))
            power += wx * wy * np.abs((image.double().numpy() * wave[..., None]).sum(axis=(0, 1))) ** 2
        np.testing.assert_allclose(found[:, j], power, rtol=0.2)
    assert seen[0] == pytest.approx(1.0, abs=1e-3)


@pytest.mark.parametrize("x", [0.0, -0.9, -1.3, -1.6])
def test_the_borders_and_edges_of_smooth_splats_count(x):
    """A splat too smooth for any power of its body: its edge is left, and the border that it crosses."""
    view = PinholeView("one", CAMERA, RigidTransform.identity())
    gaussians = _one((-1.3, -1.3, -1.3), 0.9, (x, 0.0, 3.0))  # the border: -1.745
    (exact,) = MedianFrequency(0.0).score(gaussians, [view], create_rasterizer("reference"))
    assert exact.score is not None
    assert exact.score < -4.0
    assert _estimate(gaussians, view) == pytest.approx(exact.score, abs=0.8)


def _estimate(gaussians: Gaussians, view: PinholeView) -> float:
    return SplatTable.of(gaussians).estimate(view)[0]


def test_the_median_of_one_power_is_known():
    """Of |F|² that are exponentially distributed around p, half are below p ln 2."""
    assert median_log_magnitude(np.full(32, 7.0)) == pytest.approx(0.5 * math.log(7 * math.log(2)))
    assert median_log_magnitude(np.array([1e-6, 1.0, 1.0, 1.0])) > math.log(0.2)
    assert median_log_magnitude(np.zeros(3)) == -math.inf
    assert median_log_magnitude(np.array([1.0, math.inf])) == -math.inf


def test_estimates_follow_the_scores(cluttered):
    gaussians, views = cluttered
    rasterizer = create_rasterizer("reference")
    views = views[::2]
    exact = MedianFrequency().score(gaussians, views, rasterizer)
    found = MedianFrequencyEstimate().score(gaussians, views, rasterizer)
    assert [score.name for score in found] == [view.name for view in views]
    assert all(score.estimated for score in found)
    assert not any(score.estimated for score in exact)
    assert spearmanr([e.score for e in exact], [f.score for f in found]).statistic > 0.9  # 0.98 was seen
    for e, f in zip(exact, found, strict=True):
        assert f.coverage == pytest.approx(e.coverage, abs=0.05)


def test_what_is_hidden_adds_nothing(cluttered):
    """A smooth board in front of the fine side of the wall."""
    gaussians, views = cluttered
    board = Gaussians(
        means=torch.tensor(
            [[x, y, -1.0] for x in np.linspace(0, 6, 25) for y in np.linspace(-3, 3, 25)]
        ).float(),
        log_scales=torch.full((625, 3), math.log(0.25)),
        quaternions_wxyz=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(625, 1),
        opacity_logits=torch.full((625,), 8.0),
        sh_dc=torch.zeros(625, 3),
        sh_rest=torch.zeros(625, 0, 3),
    )
    both = Gaussians(
        *(
            torch.cat(pair)
            for pair in zip(gaussians.tensors().values(), board.tensors().values(), strict=True)
        )
    )
    fine = views[10]
    assert _estimate(both, fine) < _estimate(gaussians, fine) - 1.0


def test_statuses_are_those_of_scores(ball, candidate_at):
    candidates = [
        candidate_at("away", (3, 0, 0), target=(9, 0, 0), camera=CAMERA),
        candidate_at("far", (30, 0, 0), camera=CAMERA),
        candidate_at("near", (3, 0, 0), camera=CAMERA),
    ]
    away, far, near = MedianFrequencyEstimate().score(ball, candidates, create_rasterizer("reference"))
    assert (away.status, away.score, away.coverage) == (CandidateStatus.OUT_OF_MODEL, None, 0.0)
    assert far.status is CandidateStatus.LOW_COVERAGE
    assert near.status is CandidateStatus.RANKED


def test_a_single_splat_in_front_of_black_has_a_score():
    view = PinholeView("one", CAMERA, RigidTransform.identity())
    gaussians = _one((-1.0, -1.0, -1.0), 0.9, (0.0, 0.0, 2.0))
    (score,) = MedianFrequencyEstimate().score(gaussians, [view], create_rasterizer("reference"))
    assert score.status is CandidateStatus.RANKED


def test_estimating_can_be_stopped_and_refuses_what_scoring_refuses(ball, candidate_at):
    rasterizer = create_rasterizer("reference")
    monitor = Monitor()
    monitor.cancel()
    with pytest.raises(Cancelled):
        MedianFrequencyEstimate().score(ball, [candidate_at("a", (3, 0, 0))], rasterizer, monitor=monitor)
    small = PinholeCamera(24, 18, 20.0, 20.0, 12.0, 9.0)
    views = [candidate_at("a", (3, 0, 0)), candidate_at("b", (3, 0, 0), camera=small)]
    with pytest.raises(InvalidInputError, match="different sizes"):
        MedianFrequencyEstimate().score(ball, views, rasterizer)
    with pytest.raises(InvalidInputError, match="min_coverage"):
        MedianFrequencyEstimate(min_coverage=1.5)
    assert MedianFrequencyEstimate().score(ball, [], rasterizer) == ()
