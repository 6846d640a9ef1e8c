from collections.abc import Callable

import pytest
import torch

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.optimiser import GaussianAdam, learning_rates_at
from fvs_engine.splat.settings import LearningRates

RATES = {
    "means": 1e-2,
    "log_scales": 2e-2,
    "quaternions_wxyz": 3e-2,
    "opacity_logits": 4e-2,
    "sh_dc": 5e-2,
    "sh_rest": 6e-2,
}

Make = Callable[..., Gaussians]


def set_gradients(gaussians: Gaussians, seed: int) -> None:
    draw = torch.Generator().manual_seed(seed)
    for tensor in gaussians.tensors().values():
        tensor.grad = torch.randn(tensor.shape, generator=draw)


def test_steps_equal_torch_adam_when_all_are_visible(make_gaussians: Make) -> None:
    ours, theirs = make_gaussians(12_000, 2).requires_grad_(), make_gaussians(12_000, 2).requires_grad_()
    adam = GaussianAdam(ours)
    groups = [{"params": [tensor], "lr": RATES[name]} for name, tensor in theirs.tensors().items()]
    torch_adam = torch.optim.Adam(groups, eps=1e-15)
    for seed in range(5):
        set_gradients(ours, seed)
        set_gradients(theirs, seed)
        adam.step(ours, RATES, torch.ones(12_000), sh_degree=2)
        torch_adam.step()
    for name, tensor in ours.tensors().items():
        torch.testing.assert_close(tensor, theirs.tensors()[name], rtol=1e-5, atol=1e-6)
        assert tensor.grad is None


def test_harmonics_move_only_where_they_were_seen_and_used(make_gaussians: Make) -> None:
    gaussians, before = make_gaussians(50, 2).requires_grad_(), make_gaussians(50, 2)
    adam = GaussianAdam(gaussians)
    visible = torch.arange(50) % 3 == 0
    set_gradients(gaussians, 0)
    adam.step(gaussians, RATES, visible.float(), sh_degree=1)
    moved = gaussians.sh_rest != before.sh_rest
    assert moved[visible, :3].all()
    assert not moved[~visible].any()
    assert not moved[:, 3:].any()
    assert not adam.first["sh_rest"][~visible].any()
    assert (gaussians.means != before.means).all()


def test_moments_follow_their_gaussians(make_gaussians: Make) -> None:
    gaussians = make_gaussians(10, 0).requires_grad_()
    adam = GaussianAdam(gaussians)
    set_gradients(gaussians, 2)
    adam.step(gaussians, RATES, torch.ones(10), sh_degree=0)
    before = adam.second["means"].clone()
    adam.keep(torch.tensor([7, 2]), added=3)
    assert torch.equal(adam.second["means"][:2], before[[7, 2]])
    assert adam.second["means"].shape == (5, 3)
    assert not adam.second["means"][2:].any()


def test_rate_of_means_decays_exponentially_and_scales_with_extent() -> None:
    rates = LearningRates()
    at = [learning_rates_at(rates, i, 1000, extent=5.0)["means"] for i in (0, 500, 1000, 2000)]
    assert at == pytest.approx([8e-4, 8e-5, 8e-6, 8e-6])
