import pytest
import torch
from torch import Tensor

from fvs_engine.splat.losses import photometric_loss, photometric_loss_torch
from fvs_engine.splat.triton_kernels import photometric as photometric_kernels
from fvs_engine.splat.triton_kernels.guard import HALTED_NOT_FINITE, HALTED_OVERFLOW, REASON, new_guard
from fvs_engine.splat.triton_kernels.photometric import photometric


@pytest.fixture(autouse=True)
def few_rows(monkeypatch: pytest.MonkeyPatch) -> None:
    """A program takes as many rows as the images have: in the interpreter it computes them all."""
    monkeypatch.setattr(photometric_kernels, "_ROWS", 12)


def images(height: int, width: int, device: torch.device) -> tuple[Tensor, Tensor]:
    draw = torch.Generator().manual_seed(0)
    target = torch.randint(0, 256, (height, width, 3), generator=draw, dtype=torch.uint8)
    noise = torch.rand((height, width, 3), generator=draw)
    return (0.6 * target / 255 + 0.6 * noise - 0.1).to(device), target.to(device)


def exact(
    color: Tensor, target: Tensor, ssim_weight: float, mask: Tensor | float = 1.0
) -> tuple[Tensor, Tensor]:
    leaf = color.double().requires_grad_()
    loss = photometric_loss_torch(leaf * mask, target.double() / 255, ssim_weight)
    (gradient,) = torch.autograd.grad(loss, leaf)
    return loss.detach(), gradient


def error(gradient: Tensor, expected: Tensor) -> float:
    return float((gradient - expected).abs().max() / expected.abs().max())


# The last has several programs, down and across.
@pytest.mark.parametrize(("height", "width", "ssim_weight"), [(1, 1, 0.2), (5, 7, 1.0), (6, 45, 0.2)])
def test_value_and_gradient_equal_convolutions_in_float64(
    height: int, width: int, ssim_weight: float, device: torch.device, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(photometric_kernels, "_ROWS", 4)
    color, target = images(height, width, device)
    loss, gradient = photometric(color, target, ssim_weight)
    expected, expected_gradient = exact(color, target, ssim_weight)
    assert loss.item() == pytest.approx(expected.item(), abs=1e-6)
    assert error(gradient, expected_gradient) < 1e-5


def test_nothing_is_lost_where_the_mask_is_zero(device: torch.device) -> None:
    color, target = images(5, 9, device)
    mask = (torch.arange(45).reshape(5, 9, 1) % 7 < 5).to(device, torch.float32)
    target *= mask.to(torch.uint8)
    guard = new_guard(device)
    loss, gradient = photometric(color, target, 0.2, mask, guard)
    assert not guard.any()
    expected, expected_gradient = exact(color, target, 0.2, mask.double())
    assert loss.item() == pytest.approx(expected.item(), abs=1e-6)
    assert error(gradient, expected_gradient) < 1e-5
    assert not gradient[mask[..., 0] == 0].any()


@pytest.mark.parametrize("level", [0.1, pytest.param(0.9, marks=pytest.mark.system)])
def test_faint_detail_is_seen_as_well_as_on_the_cpu(level: float, device: torch.device) -> None:
    y, x = torch.meshgrid(torch.linspace(0, 1, 12), torch.linspace(0, 1, 42), indexing="ij")
    smooth = (level + 0.05 * torch.sin(3 * x + 2 * y))[..., None].expand(12, 42, 3)
    target = (smooth * 255).round().to(torch.uint8)
    noise = torch.randn(target.shape, generator=torch.Generator().manual_seed(0))
    color = (target / 255 + 1e-3 * noise).float()
    _, gradient = photometric(color.to(device), target.to(device), 1.0)
    _, expected = exact(color, target, 1.0)
    _, numba_gradient = photometric_loss(color, target, 1.0)
    assert error(gradient.cpu(), expected) < 1.5 * error(numba_gradient, expected)


def test_a_loss_that_is_not_finite_sets_the_guard_unless_it_is_set(device: torch.device) -> None:
    color, target = images(1, 2, device)
    color[0, 1, 0] = float("nan")
    guard = new_guard(device)
    loss, _ = photometric(color, target, 0.2, guard=guard)
    assert loss.isnan()
    assert guard[REASON] == HALTED_NOT_FINITE
    guard[REASON] = HALTED_OVERFLOW
    photometric(color, target, 0.2, guard=guard)
    assert guard[REASON] == HALTED_OVERFLOW
