"""The deformable convolution against its definition, and against the plain one."""

import torch
from deformable_reference import by_definition
from torch import Tensor
from torch.nn import functional

from fvs_engine.sfm.aliked.deformable import deformable_convolution


def random(*shape: int) -> Tensor:
    return torch.randn(*shape, generator=torch.Generator().manual_seed(sum(shape)), dtype=torch.float64)


def test_it_is_the_sum_over_displaced_taps():
    features, weight = random(2, 3, 5, 4), random(2, 3, 3, 3)
    offsets = 3.0 * random(2, 18, 5, 4)  # many of them reach outside
    torch.testing.assert_close(
        deformable_convolution(features, offsets, weight), by_definition(features, offsets, weight)
    )


def test_without_offsets_it_is_a_convolution():
    features, weight = random(1, 4, 7, 6), random(5, 4, 3, 3)
    torch.testing.assert_close(
        deformable_convolution(features, torch.zeros(1, 18, 7, 6, dtype=torch.float64), weight),
        functional.conv2d(features, weight, padding=1),
    )
