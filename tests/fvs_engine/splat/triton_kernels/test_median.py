import math

import pytest
import torch
from torch import Tensor

from fvs_engine.score.log_magnitude_median import _middle_powers_of_image
from fvs_engine.splat.triton_kernels.median import middle_powers, planes_of


def random_images(*shape: int) -> Tensor:
    return 1.4 * torch.rand(shape, generator=torch.Generator().manual_seed(0)) - 0.2


def found(images: Tensor) -> Tensor:
    return middle_powers(torch.fft.rfft2(planes_of(images)), images.shape[2])


def expected(images: Tensor) -> Tensor:
    """All coefficients of the full spectrum, in order."""
    width = images.shape[2]
    half = torch.fft.rfft2(images.movedim(-1, 1).double().clamp(0, 1))
    powers = torch.view_as_real(half).square().sum(-1).float()
    columns = torch.arange(width, device=images.device)
    full = powers[..., torch.minimum(columns, width - columns)].flatten(1).sort(dim=1).values
    return full[:, [(full.shape[1] - 1) // 2, full.shape[1] // 2]]


# Odd and even, one coefficient and several programs; an odd count has one in the middle.
@pytest.mark.parametrize(
    "shape", [(2, 1, 1, 3), (1, 1, 2, 3), (1, 2, 1, 3), (1, 3, 5, 1), (2, 9, 8, 3), (2, 31, 47, 3)]
)
def test_it_is_the_middle_of_the_full_spectrum(shape: tuple[int, ...], device: torch.device) -> None:
    images = random_images(*shape).to(device)
    powers = found(images)
    assert torch.equal(powers, expected(images))
    assert torch.equal(powers[:, 0], powers[:, 1]) or images[0].numel() % 2 == 0


def test_it_is_what_the_cpu_finds(device: torch.device) -> None:
    image = random_images(9, 8, 3)
    powers = _middle_powers_of_image(image.numpy(), (107, 108))
    torch.testing.assert_close(found(image[None].to(device))[0].cpu(), torch.from_numpy(powers))


def test_images_of_a_batch_do_not_mix(device: torch.device) -> None:
    images = random_images(4, 9, 8, 3).to(device)
    images[1] = 0.0
    images[2] = 0.25
    images[3, 4, 4, 0] = math.nan
    powers = found(images)
    assert torch.equal(powers[:3], expected(images)[:3])
    assert powers[3].isnan().all()


def test_the_middle_may_be_between_nothing_and_something(device: torch.device) -> None:
    assert found(torch.full((1, 1, 2, 3), 0.25, device=device)).tolist() == [[0.0, 0.25]]


def half_of(powers: list[float], device: torch.device) -> Tensor:
    """The spectrum of images one pixel wide: all coefficients are edges, and their own."""
    return (
        torch.tensor(powers, dtype=torch.float64, device=device)
        .sqrt()
        .to(torch.complex128)
        .reshape(1, 1, -1, 1)
    )


@pytest.mark.parametrize("power", [1.0, 1.5e-45, 3.0e38])
def test_equal_ones_are_told_from_the_next_float(power: float, device: torch.device) -> None:
    nearest = torch.tensor(power, dtype=torch.float32)
    next_one = torch.nextafter(nearest, torch.tensor(math.inf)).item()
    low = nearest.item()
    assert middle_powers(half_of([next_one, low, low, next_one], device), 1).tolist() == [[low, next_one]]
    assert middle_powers(half_of([next_one, low, low, low], device), 1).tolist() == [[low, low]]


@pytest.mark.parametrize("power", [math.inf, math.nan])
def test_what_is_not_finite_has_no_middle(power: float, device: torch.device) -> None:
    assert middle_powers(half_of([1.0, power, 2.0], device), 1).isnan().all()
