"""Fisher and D-optimality against exact derivatives of every pixel, by autograd in float64."""

import numpy as np
import pytest
import torch

from fvs_engine.lab.baselines import create_selector
from fvs_engine.lab.baselines.information import estimated_information, view_information
from fvs_engine.score.selectors.interface import select
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import SquaringRasterizer, create_rasterizer
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import PinholeView


@pytest.fixture(
    params=["cpu", *(pytest.param(name, marks=pytest.mark.cuda) for name in ("gsplat", "triton"))],
)
def rasterizer(request):
    return create_rasterizer(request.param)


@pytest.fixture
def few(ball) -> Gaussians:
    few = Gaussians(**{name: tensor[:15].clone() for name, tensor in ball.tensors().items()})
    few.log_scales += 1 + 0.5 * torch.randn(15, 3, generator=torch.Generator().manual_seed(1))
    return few


@pytest.fixture
def ring(ring):
    """Images so small that every pixel can have a backward pass of its own."""

    def make(*angles_deg):
        return tuple(
            PinholeView(view.name, view.camera.resized(8, 6), view.camera_from_model)
            for view in ring(*angles_deg)
        )

    return make


def exact_information(gaussians, view, rasterizer, mask=None) -> torch.Tensor:
    """The definition: one backward pass for every pixel and channel, all of them at once."""
    leaves = Gaussians(**{name: t.detach().double() for name, t in gaussians.tensors().items()})
    inputs = [leaves.means, leaves.log_scales, leaves.opacity_logits, leaves.sh_dc]
    for tensor in inputs:
        tensor.requires_grad_()
    color = rasterizer.render(leaves, view.camera, view.camera_from_model).color
    if mask is not None:
        color = color * torch.from_numpy(mask)[..., None]
    rows = torch.autograd.grad(
        color, inputs, torch.eye(color.numel()).double().reshape(-1, *color.shape), is_grads_batched=True
    )
    return torch.cat([row.square().sum(0).reshape(len(gaussians), -1) for row in rows], dim=1)


def test_the_exact_way_is_the_definition(few, ring, reference):
    cpu = create_rasterizer("cpu")
    assert isinstance(cpu, SquaringRasterizer)
    for view in ring(10, 200):
        found = view_information(few, view, cpu)
        expected = exact_information(few, view, reference)
        assert expected.max() > 0.01
        np.testing.assert_allclose(found.diagonal, expected, rtol=1e-3, atol=1e-5 * float(expected.max()))
        rendering = cpu.render(few, view.camera, view.camera_from_model)
        assert found.coverage == pytest.approx(float(rendering.alpha.mean()))


def test_masked_pixels_have_no_information(few, ring, reference):
    (view,) = ring(10)
    mask = np.zeros((6, 8), dtype=bool)
    mask[2:5, 3:6] = True
    masked = TrainingView("m", view.camera, view.camera_from_model, np.zeros((6, 8, 3), np.uint8), mask)
    cpu = create_rasterizer("cpu")
    found = view_information(few, masked, cpu, probes=400).diagonal.sum(dim=0)
    expected = exact_information(few, view, reference, mask).sum(dim=0)
    whole = view_information(few, view, cpu).diagonal.sum(dim=0)
    np.testing.assert_allclose(found, expected, rtol=0.1)
    assert (found < 0.9 * whole).all()


def test_harmonics_count_by_their_basis(few, ring):
    """A view's colours depend on all coefficients of one channel through the same weights."""
    few.sh_rest = torch.zeros(len(few), 15, 3)
    (view,) = ring(30)
    exact = view_information(few, view, create_rasterizer("cpu")).diagonal
    assert exact.shape == (len(few), 55)
    probed = estimated_information(few, view, create_rasterizer("cpu"), probes=400).diagonal
    # The means of harmonics that are all zero do not turn the colours, so every column can be compared.
    assert float((exact - probed).norm() / exact.norm()) < 0.1
    columns = exact[:, 10:].sum(0)
    np.testing.assert_allclose(probed[:, 10:].sum(0), columns, rtol=0.2, atol=0.02 * float(columns.max()))
    assert view_information(few, view, create_rasterizer("cpu"), sh_degree=1).diagonal.shape[1] == 19


def test_probes_are_unbiased_and_repeatable(few, ring, rasterizer, reference):
    (view,) = ring(10)
    here = few.to(rasterizer.device)
    expected = exact_information(few, view, reference)
    found = estimated_information(here, view, rasterizer, probes=200).diagonal.cpu().double()
    # The error of the sum over independent entries: √(2 / probes) of each, 0.1, averaged over many.
    assert float((found.sum(0) - expected.sum(0)).norm() / expected.sum(0).norm()) < 0.1
    assert float((found - expected).norm() / expected.norm()) < 0.2
    twice = [estimated_information(here, view, rasterizer, seed=3).diagonal for _ in range(2)]
    assert torch.equal(*twice)
    assert not torch.equal(twice[0], estimated_information(here, view, rasterizer, seed=4).diagonal)


@pytest.mark.parametrize("name", ["fisher", "d-optimal"])
def test_scores_are_the_formulas_applied_to_exact_derivatives(few, ring, context, reference, name):
    visited, candidates = ring(0, 40), ring(90, 200)
    known = sum(exact_information(few, view, reference) for view in visited) + 1e-6
    here = context(visited, candidates, gaussians=few, rasterizer=create_rasterizer("cpu"))
    for view, score in zip(candidates, create_selector(name).score(here), strict=True):
        ratio = exact_information(few, view, reference) / known
        expected = (1 + ratio.sum()).log10() if name == "fisher" else 0.5 * ratio.log1p().mean()
        assert -score.score == pytest.approx(float(expected), rel=2e-3)


@pytest.mark.parametrize("name", ["fisher", "d-optimal"])
def test_an_unseen_side_says_more_than_a_seen_one(ball, ring, context, rasterizer, name):
    here = context(
        ring(0, 10, 350), ring(5, 180), gaussians=ball.to(rasterizer.device), rasterizer=rasterizer
    )
    assert select(here, create_selector(name), {}).chosen == "180"


def test_views_that_follow_one_another_are_diverse(ring, context, chosen_in_turn):
    here = context(ring(0), ring(178, 180, 182, 90), rasterizer=create_rasterizer("cpu"))
    assert "090" in chosen_in_turn(here, create_selector("d-optimal"), 2)
