import numba
import pytest
import torch

from fvs_engine.splat.losses import photometric_loss, photometric_loss_torch, ssim_map

SIZES = [(1, 1), (7, 5), (11, 11), (37, 53), (64, 32), (70, 131)]


def images(height: int, width: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    draw = torch.Generator().manual_seed(seed)
    target = torch.randint(0, 256, (height, width, 3), generator=draw, dtype=torch.uint8)
    noise = torch.rand((height, width, 3), generator=draw)
    return 0.6 * target / 255 + 0.6 * noise - 0.1, target


@pytest.mark.parametrize(("height", "width"), SIZES)
@pytest.mark.parametrize("ssim_weight", [0.0, 0.2, 1.0])
def test_value_and_gradient_equal_convolutions_in_float64(
    height: int, width: int, ssim_weight: float
) -> None:
    color, target = images(height, width)
    loss, gradient = photometric_loss(color, target, ssim_weight)
    exact = color.double().requires_grad_()
    exact_loss = photometric_loss_torch(exact, target.double() / 255, ssim_weight)
    exact_loss.backward()
    assert loss.item() == pytest.approx(exact_loss.item(), abs=1e-6)
    assert exact.grad is not None
    error = (gradient - exact.grad).abs().max() / exact.grad.abs().max()
    assert error < 1e-5


def test_ssim_equals_its_definition_at_a_pixel() -> None:
    """Σ over the 11 × 11 window, written out, where the window lies inside the image."""
    color, target = images(15, 17)
    x, y = color.double(), target.double() / 255
    offsets = torch.arange(11, dtype=torch.float64) - 5
    line = torch.exp(-(offsets**2) / (2 * 1.5**2))
    window = torch.outer(line, line) / torch.outer(line, line).sum()
    a, b = x[2:13, 3:14, 1], y[2:13, 3:14, 1]
    mean_a, mean_b = (window * a).sum(), (window * b).sum()
    variance_a = (window * (a - mean_a) ** 2).sum()
    variance_b = (window * (b - mean_b) ** 2).sum()
    covariance = (window * (a - mean_a) * (b - mean_b)).sum()
    expected = ((2 * mean_a * mean_b + 1e-4) * (2 * covariance + 9e-4)) / (
        (mean_a**2 + mean_b**2 + 1e-4) * (variance_a + variance_b + 9e-4)
    )
    assert ssim_map(x, y)[1, 7, 8].item() == pytest.approx(expected.item(), abs=1e-12)


def test_equal_images_cost_nothing() -> None:
    _, target = images(40, 30)
    assert photometric_loss(target / 255, target)[0].item() == pytest.approx(0, abs=1e-6)


def test_result_does_not_depend_on_threads() -> None:
    color, target = images(300, 40)
    before = numba.get_num_threads()
    results = []
    for threads in {1, before}:
        numba.set_num_threads(threads)
        loss, gradient = photometric_loss(color, target)
        results.append((loss.item(), gradient))
    numba.set_num_threads(before)
    assert all(value == results[0][0] and torch.equal(grad, results[0][1]) for value, grad in results)


def test_a_non_finite_rendering_is_not_hidden() -> None:
    color, target = images(30, 30)
    color[4, 4, 0] = float("nan")
    assert not torch.isfinite(photometric_loss(color, target)[0])
