"""The score against its definition in numpy, and against what it is known to see in photographs."""

import math
from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image
from scipy.ndimage import gaussian_filter

from fvs_engine.errors import InvalidInputError
from fvs_engine.score import median_log_magnitude


def oracle(image: np.ndarray) -> float:
    with np.errstate(divide="ignore"):
        return float(np.median(np.log(np.abs(np.fft.fft2(image.astype(np.float64), axes=(0, 1))))))


def score(image: np.ndarray) -> float:
    return float(median_log_magnitude(torch.from_numpy(np.ascontiguousarray(image, dtype=np.float32))[None]))


def load(paths) -> list[np.ndarray]:
    return [np.asarray(Image.open(path).convert("RGB"), dtype=np.float32) / 255 for path in paths]


@pytest.fixture(scope="module")
def photographs(kermit_dir):
    return load(sorted(kermit_dir.iterdir())[::4])


@pytest.fixture(scope="module")
def change(photographs):
    """What an operation does to the score: one difference per photograph."""

    def differences(operation) -> np.ndarray:
        return np.array([score(operation(image)) - score(image) for image in photographs])

    return differences


def blurred(sigma_px):
    return lambda image: gaussian_filter(image, (sigma_px, sigma_px, 0))


def unobserved(share):
    def blacken(image):
        result = image.copy()
        result[:, : round(share * image.shape[1])] = 0
        return result

    return blacken


def with_noise(image):
    noise = np.random.default_rng(0).normal(scale=0.02, size=image.shape)
    return np.clip(image + noise, 0, 1)


def with_needles(image):
    generator = np.random.default_rng(0)
    result = image.copy()
    for row in generator.integers(0, image.shape[0], 150):
        start, length = generator.integers(0, image.shape[1]), generator.integers(20, 200)
        result[row, start : start + length] = generator.uniform(size=3)
    return result


@given(height=st.integers(1, 24), width=st.integers(1, 24), seed=st.integers(0, 1000))
def test_it_is_the_definition(height, width, seed):
    image = np.random.default_rng(seed).uniform(size=(height, width, 3)).astype(np.float32)
    assert score(image) == pytest.approx(oracle(image), abs=1e-5)


@pytest.mark.parametrize("operation", [lambda image: image, blurred(1), blurred(4), unobserved(0.9)])
def test_it_is_the_definition_on_photographs(photographs, operation):
    for image in photographs:
        changed = operation(image)
        assert score(changed) == pytest.approx(oracle(changed), abs=1e-5)


def test_it_is_the_definition_whichever_side_has_an_awkward_length(photographs):
    (image, *_) = photographs
    for height, width in ((97, 120), (120, 97), (97, 101)):
        cut = image[100 : 100 + height, 100 : 100 + width]
        assert score(cut) == pytest.approx(oracle(cut), abs=1e-5)


def test_it_is_the_definition_where_hardly_anything_varies():
    y, x = np.mgrid[:90, :120]
    blob = np.exp(-((x - 60) ** 2 + (y - 40) ** 2) / 200)[..., None] * [0.5, 0.3, 0.9]
    blob = blob.astype(np.float32)
    assert score(blob) == pytest.approx(oracle(blob), abs=1e-5)
    assert score(blob) < -9  # float32 rounding alone would give more


def test_zeros_in_the_spectrum_count_as_numpy_counts_them():
    row = np.random.default_rng(1).uniform(size=(1, 64, 3))
    striped = np.repeat(row, 64, axis=0).astype(np.float32)  # all but 1 in 64 coefficients are zero
    assert score(striped) == -math.inf
    checked = np.random.default_rng(2).uniform(size=(64, 64, 3)).astype(np.float32)
    checked[:, 1::2] = checked[:, ::2]  # makes coefficients in column 32 zero, far fewer than half
    assert score(checked) == pytest.approx(oracle(checked), abs=1e-5)


def test_blur_lowers_the_score_the_more_the_wider(change):
    sharp_to_blurred = [change(blurred(sigma_px)) for sigma_px in (1, 2)]
    assert (sharp_to_blurred[0] < -1).all()
    assert (sharp_to_blurred[1] < sharp_to_blurred[0]).all()
    assert (change(blurred(4)) < sharp_to_blurred[0]).all()


def test_half_exposure_is_exactly_ln_half(change):
    np.testing.assert_allclose(change(lambda image: 0.5 * image), math.log(0.5), atol=1e-6)


def test_unobserved_parts_weigh_less_than_a_pixel_of_blur(change):
    half, most = change(unobserved(0.5)), change(unobserved(0.9))
    assert (half < 0).all()
    assert (most < half).all()
    assert (change(blurred(1)) < most).all()


def test_noise_and_needles_hide_blur(change):
    blurred_only = change(blurred(2))
    noisy = change(lambda image: with_noise(blurred(2)(image)))
    needled = change(lambda image: with_needles(blurred(2)(image)))
    assert (noisy > blurred_only + 1).all()
    assert (needled > blurred_only + 0.5).all()
    assert (needled < 0).all()


def test_noise_makes_a_blurred_photograph_look_better_than_a_sharp_one(data_dir):
    """Where the scene itself has little grain: that of `kermit` leaves noise less to hide."""
    images = load(sorted((data_dir / "truck11" / "images").iterdir())[::4])
    assert [score(with_noise(blurred(2)(image))) > score(image) for image in images] == [True] * 3


def test_half_resolution_lowers_the_score(change):
    def halved(image):
        height, width, _ = image.shape
        return image.reshape(height // 2, 2, width // 2, 2, 3).mean((1, 3))

    assert (change(halved) < 0).all()


def test_shifts_and_mirrors_change_nothing(change):
    np.testing.assert_allclose(change(lambda image: np.roll(image, (31, 77), (0, 1))), 0, atol=1e-6)
    np.testing.assert_allclose(change(lambda image: image[:, ::-1]), 0, atol=1e-6)
    np.testing.assert_allclose(change(lambda image: image.transpose(1, 0, 2)), 0, atol=1e-6)


def test_a_batch_is_like_one_image_at_a_time(photographs):
    images = torch.from_numpy(np.stack([image[:200, :301] for image in photographs]))
    together = median_log_magnitude(images)
    assert together.shape == (len(images),)
    for image, value in zip(images, together, strict=True):
        assert float(median_log_magnitude(image[None])) == float(value)


def test_several_threads_may_score_at_once(photographs):
    images = [torch.from_numpy(image)[None] for image in photographs]
    one_by_one = [float(median_log_magnitude(image)) for image in images]
    with ThreadPoolExecutor(4) as threads:
        at_once = list(threads.map(lambda image: float(median_log_magnitude(image)), images * 8))
    assert at_once == one_by_one * 8


def test_colours_beyond_the_display_are_clamped_and_the_input_is_left_alone(photographs):
    image = torch.from_numpy(photographs[0]).double()[None] * 1.5 - 0.1
    before = image.clone()
    assert median_log_magnitude(image) == median_log_magnitude(image.clamp(0, 1))
    assert torch.equal(image, before)


@pytest.mark.parametrize("grey", [0.0, 1 / 3, 1.0])
def test_blank_images_have_no_structure(grey):
    assert score(np.full((40, 50, 3), grey)) == -math.inf


def test_a_nan_is_not_hidden():
    image = np.full((8, 8, 3), 0.5)
    image[2, 3, 1] = np.nan
    assert math.isnan(score(image))


@pytest.mark.parametrize(
    ("shape", "dtype"),
    [
        ((4, 4, 3), torch.float32),
        ((1, 4, 4, 4), torch.float32),
        ((0, 4, 4, 3), torch.float32),
        ((1, 4, 4, 3), torch.uint8),
    ],
)
def test_what_is_not_an_image_is_refused(shape, dtype):
    with pytest.raises(InvalidInputError):
        median_log_magnitude(torch.zeros(shape, dtype=dtype))


@pytest.mark.cuda
def test_cuda_agrees_with_the_cpu(photographs):
    images = torch.from_numpy(np.stack(photographs))
    on_gpu = median_log_magnitude(images.cuda()).cpu()
    torch.testing.assert_close(on_gpu, median_log_magnitude(images), atol=1e-6, rtol=0)
