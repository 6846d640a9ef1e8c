import numpy as np
import pytest

from fvs_engine.errors import InvalidInputError
from fvs_engine.splat.metrics import psnr, ssim


def test_psnr_of_a_known_error() -> None:
    a = np.full((8, 9, 3), 0.5)
    assert psnr(a, a + 0.1) == pytest.approx(20.0)
    assert psnr(a, a + 0.01) == pytest.approx(40.0)


def test_equal_images_are_finite_and_perfect() -> None:
    a = np.random.default_rng(0).random((20, 30, 3))
    assert psnr(a, a) == 100.0
    assert ssim(a, a) == pytest.approx(1.0)


def test_values_outside_the_range_are_clamped() -> None:
    a = np.ones((12, 12, 3))
    assert psnr(a, a + 7) == 100.0
    assert ssim(a, a + 7) == pytest.approx(1.0)


def test_ssim_falls_with_noise_and_is_symmetric() -> None:
    rng = np.random.default_rng(1)
    a = np.tile(np.linspace(0, 1, 40)[None, :, None], (30, 1, 3))
    little, much = (np.clip(a + s * rng.normal(size=a.shape), 0, 1) for s in (0.02, 0.2))
    assert 1 > ssim(a, little) > ssim(a, much) > 0
    assert ssim(a, much) == pytest.approx(ssim(much, a))


def test_shapes_must_agree() -> None:
    with pytest.raises(InvalidInputError, match="cannot be compared"):
        psnr(np.zeros((4, 4, 3)), np.zeros((4, 5, 3)))


def test_only_what_counts_is_compared() -> None:
    draw = np.random.default_rng(3)
    a, b = draw.random((2, 24, 30, 3))
    mask = np.zeros((24, 30), dtype=bool)
    mask[:, :12] = True
    other = np.where(mask[..., None], b, draw.random(b.shape))
    assert psnr(a, b, mask) == psnr(a, other, mask) == pytest.approx(psnr(a[:, :12], b[:, :12]))
    assert ssim(a, b, mask) == pytest.approx(ssim(a, other, mask))
    assert ssim(a, np.where(mask[..., None], a, b), mask) == pytest.approx(1.0)
    assert psnr(a, b, np.ones_like(mask)) == pytest.approx(psnr(a, b))
    for metric in (psnr, ssim):
        with pytest.raises(InvalidInputError, match="every pixel"):
            metric(a, b, np.zeros_like(mask))
