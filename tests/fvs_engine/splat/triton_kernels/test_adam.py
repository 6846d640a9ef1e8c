import pytest
import torch
from torch import Tensor

from fvs_engine.splat.densification import GradientStatistics
from fvs_engine.splat.optimiser import BETA_FIRST, BETA_SECOND, EPSILON
from fvs_engine.splat.raster.interface import Rendering
from fvs_engine.splat.triton_kernels.adam import adam_step, add_gradients
from fvs_engine.splat.triton_kernels.guard import HALTED_OVERFLOW, REASON, new_guard

STEP = 7
CORRECTIONS = (1 - BETA_FIRST**STEP, 1 - BETA_SECOND**STEP)
RATE = 1e-2


def expect_step(
    tensors: tuple[Tensor, ...], visible: Tensor, columns: int, step_size: float, correction_second: float
) -> None:
    """Adam in plain torch, in place, on the first ``columns`` of the rows that are ``visible``."""
    parameter, gradient, first, second = (t.reshape(len(visible), -1)[:, :columns] for t in tensors)
    seen = visible[:, None]
    first.copy_(torch.where(seen, first.lerp(gradient, 1 - BETA_FIRST), first))
    second.copy_(torch.where(seen, second * BETA_SECOND + (1 - BETA_SECOND) * gradient**2, second))
    update = step_size * first / ((second / correction_second).sqrt() + EPSILON)
    parameter.sub_(torch.where(seen, update, torch.zeros_like(update)))


def tensors(device: torch.device, *shape: int) -> tuple[Tensor, Tensor, Tensor, Tensor]:
    """A parameter, its gradient from tiny to large, and its moments."""
    draw = torch.Generator().manual_seed(0)
    parameter, gradient, first, second = (torch.randn(shape, generator=draw).to(device) for _ in range(4))
    return parameter, gradient * 10 ** (6 * first - 6), first * 1e-3, second.square() * 1e-6


def step(given: tuple[Tensor, Tensor, Tensor, Tensor], guard: Tensor, **options: object) -> None:
    rules = {"corrections": CORRECTIONS, "betas": (BETA_FIRST, BETA_SECOND), "epsilon": EPSILON}
    adam_step(given, guard, step_size=RATE, **rules, **options)  # type: ignore[arg-type]


# 1,800 and 2,250 numbers: the last block is not full.
@pytest.mark.parametrize("shape", [(600, 3), (1,), (0, 3)])
def test_a_step_equals_torch(shape: tuple[int, ...], device: torch.device) -> None:
    given = tensors(device, *shape)
    expected = tuple(tensor.double() for tensor in given)
    if len(expected[0]):
        everyone = torch.ones(shape[0], dtype=torch.bool, device=device)
        expect_step(expected, everyone, expected[0][0].numel(), RATE / CORRECTIONS[0], CORRECTIONS[1])
    step(given, new_guard(device))
    for tensor, wanted in zip(given, expected, strict=True):
        torch.testing.assert_close(tensor.double(), wanted, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("columns", [0, 9, 45])
def test_only_columns_of_visible_rows_move(columns: int, device: torch.device) -> None:
    given, before = tensors(device, 50, 15, 3), tensors(device, 50, 15, 3)
    radii = torch.arange(50, device=device) % 3 - 1.0
    radii[4] = float("nan")
    step(given, new_guard(device), radii=radii, columns=columns)
    expected = tuple(tensor.double() for tensor in before)
    expect_step(expected, radii > 0, columns, RATE / CORRECTIONS[0], CORRECTIONS[1])
    for tensor, wanted in zip(given, expected, strict=True):
        torch.testing.assert_close(tensor.double(), wanted, rtol=1e-6, atol=1e-7)
    for tensor, old in zip(given, before, strict=True):
        assert torch.equal(tensor[~(radii > 0)], old[~(radii > 0)])


def test_the_statistics_equal_those_of_the_cpu(device: torch.device) -> None:
    rows = torch.randn((1100, 10), generator=torch.Generator().manual_seed(0)).to(device) * 1e-6
    radii = torch.arange(1100, device=device) % 4 - 1.0
    centers = torch.zeros((1100, 2), requires_grad=True)
    centers.grad = rows[:, :2].cpu().clone()
    statistics = GradientStatistics(1100, torch.device("cpu"))
    total, views = torch.zeros((2, 1100), device=device)
    for gradients in (rows, centers.grad.to(device)):
        statistics.add(Rendering(torch.zeros(60, 100, 3), torch.zeros(60, 100), None, radii.cpu(), centers))
        add_gradients(gradients, radii, (100, 60), total, views, new_guard(device))
    torch.testing.assert_close(total.cpu(), statistics.total)
    assert torch.equal(views.cpu(), statistics.views)


def test_nothing_changes_while_the_guard_is_set(device: torch.device) -> None:
    guard = new_guard(device)
    guard[REASON] = HALTED_OVERFLOW
    given, before = tensors(device, 4, 3), tensors(device, 4, 3)
    total, views = torch.zeros((2, 4), device=device)
    step(given, guard)
    add_gradients(given[1], torch.ones(4, device=device), (10, 10), total, views, guard)
    assert all(torch.equal(tensor, old) for tensor, old in zip(given, before, strict=True))
    assert not total.any()
    assert not views.any()


def test_no_gaussians_have_no_statistics(device: torch.device) -> None:
    none = torch.zeros(0, device=device)
    add_gradients(none[:, None], none, (10, 10), none, none, new_guard(device))
