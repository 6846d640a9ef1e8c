"""The median frequency: how much fine detail a rendered view shows.

Source: the paper's released code. The score is the median log-magnitude of the render's spectrum, which in
practice measures detail near 0.4 cycles/px; blurred, hence badly reconstructed, views score low and come
first.
"""

import math

import torch
from torch import Tensor

from fvs_engine.monitor import Monitor
from fvs_engine.score.log_magnitude_median import compile_kernels, median_log_of_spectra
from fvs_engine.score.renderings import RenderingScorer, require_images

_ROUNDING = 600 * torch.finfo(torch.float64).eps
"""Median magnitude, relative to the mean of a white image, up to which it is rounding."""


def median_log_magnitude(images: Tensor) -> Tensor:
    """median(ln |FFT2(I)|) over all 3·H·W coefficients of each image: float64 [B] on the images' device.

    ``images`` [B, H, W, 3] are colours, clamped to [0, 1] as a display would. No window, no shift, no
    normalisation. −inf for images without structure (blank), NaN where a pixel is NaN. Raises
    ``InvalidInputError`` for another shape or type.
    """
    require_images(images)
    height, width = images.shape[1:3]
    scores = median_log_of_spectra(images)
    return scores.masked_fill(scores < math.log(_ROUNDING * math.sqrt(height * width)), -math.inf)


class MedianFrequency(RenderingScorer):
    """Scores a candidate by the median log-magnitude of its render on black.

    The score is blind to missing coverage (90 % of a view unobserved lowers it less than 1 px of blur), so a
    view that the model fills by less than ``min_coverage`` is reported as ``low-coverage``, not ranked.
    """

    name = "median-frequency"

    def measure(self, images: Tensor) -> Tensor:
        """See ``median_log_magnitude``."""
        return median_log_magnitude(images)

    def prepare(self, device: torch.device, monitor: Monitor) -> None:
        """Compile the kernels of the CPU."""
        if device.type == "cpu":
            compile_kernels(monitor)
