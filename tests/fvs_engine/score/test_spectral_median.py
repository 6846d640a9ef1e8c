import math

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.ndimage import gaussian_filter

from fvs_engine.errors import InvalidInputError
from fvs_engine.score import SpectralMedian, spectral_median_frequency
from fvs_engine.splat.raster import create_rasterizer


def measured(image: np.ndarray) -> float:
    return float(spectral_median_frequency(torch.from_numpy(np.ascontiguousarray(image, np.float32))[None]))


def oracle(image: np.ndarray) -> float:
    """All coefficients of the full spectrum, one after another."""
    height, width, _ = image.shape
    window = np.outer(
        np.sin(np.pi * (np.arange(height) + 0.5) / height) ** 2,
        np.sin(np.pi * (np.arange(width) + 0.5) / width) ** 2,
    )[..., None]
    image = image.astype(np.float64)
    flat = (image - (image * window).sum((0, 1)) / window.sum()) * window
    power = (np.abs(np.fft.fft2(flat, axes=(0, 1))) ** 2).sum(-1)
    radius = np.hypot(np.fft.fftfreq(height)[:, None], np.fft.fftfreq(width)[None])
    frequencies = np.unique(radius.round(12))
    below = np.array([power[radius <= limit + 1e-9].sum() for limit in frequencies])
    return float(frequencies[np.searchsorted(below, power.sum() / 2)])


def wave(cycles_per_px: float, size: int = 128) -> np.ndarray:
    y, x = np.mgrid[:size, :size]
    values = 0.5 + 0.3 * np.sin(2 * np.pi * cycles_per_px * (0.6 * x + 0.8 * y))
    return np.repeat(values[..., None], 3, axis=2)


@given(height=st.integers(3, 20), width=st.integers(3, 20), seed=st.integers(0, 1000))
def test_it_is_the_definition(height, width, seed):
    image = np.random.default_rng(seed).uniform(size=(height, width, 3)).astype(np.float32)
    assert measured(image) == pytest.approx(oracle(image), abs=1e-9)


@pytest.mark.parametrize("frequency", [0.05, 0.13, 0.31, 0.45])
def test_a_wave_has_its_own_frequency(frequency):
    assert measured(wave(frequency)) == pytest.approx(frequency, abs=1 / 128)


def test_it_is_known_for_white_noise_and_for_a_blur():
    image = np.random.default_rng(0).normal(0.5, 0.1, size=(256, 256, 3)).clip(0, 1)
    assert measured(image) == pytest.approx(math.sqrt(0.5 / math.pi), rel=0.01)  # a disc of half the area
    # A Gaussian blur leaves exp(−4π²σ²f²) of the energy: half of it lies under √ln 2 / (2πσ).
    sigma_px = 2.0
    blurred = gaussian_filter(image, (sigma_px, sigma_px, 0))
    assert measured(blurred) == pytest.approx(math.sqrt(math.log(2)) / (2 * math.pi * sigma_px), rel=0.05)


def test_blur_lowers_it_and_neither_exposure_nor_contrast_changes_it(kermit_dir):
    path = min(kermit_dir.iterdir())
    image = np.asarray(Image.open(path).convert("RGB"), dtype=np.float32) / 255
    found = [measured(gaussian_filter(image, (s, s, 0))) for s in (0, 2, 8)]
    assert found[0] > found[1] > found[2] > 0
    assert measured(0.5 * image) == pytest.approx(found[0], abs=1e-9)
    assert measured(0.5 * image + 0.3) == pytest.approx(found[0], abs=1e-9)


@pytest.mark.parametrize("grey", [0.0, 1 / 3, 1.0, math.nan])
def test_what_has_no_structure_has_no_frequency(grey):
    image = np.full((40, 50, 3), 0.5)
    image[:] = grey
    assert math.isnan(measured(image))


def test_views_are_judged_as_every_scorer_does(ball, candidate_at):
    away, far = candidate_at("away", (3, 0, 0), target=(9, 0, 0)), candidate_at("far", (30, 0, 0))
    near = candidate_at("near", (3, 0, 0))
    scores = SpectralMedian().score(ball, [away, far, near], create_rasterizer("cpu"))
    assert [score.status for score in scores] == ["out-of-model", "low-coverage", "ranked"]
    assert 0 < scores[2].score < math.sqrt(0.5)


@pytest.mark.parametrize("shape", [(4, 4, 3), (1, 4, 4, 4), (0, 4, 4, 3)])
def test_what_is_not_an_image_is_refused(shape):
    with pytest.raises(InvalidInputError):
        spectral_median_frequency(torch.zeros(shape))


@pytest.mark.cuda
def test_cuda_agrees_with_the_cpu():
    images = torch.rand(2, 50, 60, 3, generator=torch.Generator().manual_seed(0))
    torch.testing.assert_close(
        spectral_median_frequency(images.cuda()).cpu(), spectral_median_frequency(images)
    )
