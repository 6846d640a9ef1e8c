"""The basis against scipy's complex spherical harmonics: orthonormal, with the signs that 3DGS files use."""

import numpy as np
import pytest
import torch
from scipy.special import sph_harm_y

from fvs_engine.splat.spherical_harmonics import SH_C0, dc_from_color, sh_basis, sh_colors


def directions(count: int) -> torch.Tensor:
    generator = torch.Generator().manual_seed(1)
    return torch.nn.functional.normalize(
        torch.randn(count, 3, generator=generator, dtype=torch.float64), dim=-1
    )


@pytest.mark.parametrize("degree", [0, 1, 2, 3])
def test_basis_is_the_real_spherical_harmonics(degree):
    d = directions(50)
    theta, phi = np.arccos(d[:, 2].numpy()), np.arctan2(d[:, 1].numpy(), d[:, 0].numpy())
    found = sh_basis(d, 3).numpy()
    for order in range(-degree, degree + 1):
        value = sph_harm_y(degree, abs(order), theta, phi)
        expected = value.real if order >= 0 else value.imag
        expected = expected * (np.sqrt(2.0) if order else 1.0)
        assert np.allclose(found[:, degree * degree + degree + order], expected, atol=1e-12), order


def test_colors_are_clamped_and_start_from_the_given_color():
    colors = torch.tensor([[0.2, 0.9, 0.0], [1.0, 0.5, 0.3]], dtype=torch.float64)
    d = directions(2)
    assert torch.allclose(sh_colors(dc_from_color(colors), torch.zeros(2, 15, 3), d, 3), colors)
    dark = torch.full((2, 3), -1.0 / SH_C0, dtype=torch.float64)
    assert torch.equal(sh_colors(dark, torch.zeros(2, 0, 3), d, 0), torch.zeros(2, 3, dtype=torch.float64))
