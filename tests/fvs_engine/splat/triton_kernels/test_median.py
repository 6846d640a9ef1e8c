import math

import pytest
import torch
from torch import Tensor

from fvs_engine.score.log_magnitude_median import _middle_powers
from fvs_engine.splat.triton_kernels.median import middle_powers, planes_of


def random_images(*shape: int) -> Tensor:
    return 1.4 * torch.rand(shape, generator=torch.Generator().manual_seed(0)) - 0.2


def found(images: Tensor) -> Tensor:
    return middle_powers(torch.fft.rfft2(planes_of(images)), images.shape[2])


def expected(images: Tensor) -> Tensor:
    total = images[0].numel()
    return _middle_powers(images, ((total - 1) // 2, total // 2))


# Odd and even, one coefficient and several programs; an odd count has one in the middle.
@pytest.mark.parametrize(
    "shape", [(2, 1, 1, 3), (1, 1, 2, 3), (1, 2, 1, 3), (1, 3, 5, 1), (2, 9, 8, 3), (2, 31, 47, 3)]
)
def test_it_equals_bisection(shape: tuple[int, ...]) -> None:
    images = random_images(*shape)
    powers = found(images)
    assert torch.equal(powers, expected(images))
    assert torch.equal(powers[:, 0], powers[:, 1]) or images[0].numel() % 2 == 0


def test_images_of_a_batch_do_not_mix() -> None:
    images = random_images(4, 9, 8, 3)
    images[1] = 0.0
    images[2] = 0.25
    images[3, 4, 4, 0] = math.nan
    powers = found(images)
    assert torch.equal(powers[:3], expected(images)[:3])
    assert powers[3].isnan().all()


def test_the_middle_may_be_between_nothing_and_something() -> None:
    assert found(torch.full((1, 1, 2, 3), 0.25)).tolist() == [[0.0, 0.25]]


def half_of(powers: list[float]) -> Tensor:
    """The spectrum of images one pixel wide: all coefficients are edges, and their own."""
    return torch.tensor(powers, dtype=torch.float64).sqrt().to(torch.complex128).reshape(1, 1, -1, 1)


@pytest.mark.parametrize("power", [1.0, 1.5e-45, 3.0e38])
def test_equal_ones_are_told_from_the_next_float(power: float) -> None:
    nearest = torch.tensor(power, dtype=torch.float32)
    next_one = torch.nextafter(nearest, torch.tensor(math.inf)).item()
    low = nearest.item()
    assert middle_powers(half_of([next_one, low, low, next_one]), 1).tolist() == [[low, next_one]]
    assert middle_powers(half_of([next_one, low, low, low]), 1).tolist() == [[low, low]]


@pytest.mark.parametrize("power", [math.inf, math.nan])
def test_what_is_not_finite_has_no_middle(power: float) -> None:
    assert middle_powers(half_of([1.0, power, 2.0]), 1).isnan().all()
