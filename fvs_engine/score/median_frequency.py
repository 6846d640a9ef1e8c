"""The median frequency: how much fine detail a rendered view shows.

Source: the paper's released code. The score is the median log-magnitude of the render's spectrum, which in
practice measures detail near 0.4 cycles/px; blurred, hence badly reconstructed, views score low, come first.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import torch
from torch import Tensor

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.score.interface import Candidate, CandidateScore
from fvs_engine.score.renderings import MIN_COVERAGE, check_min_coverage, score_renderings
from fvs_engine.score.spectrum_median import compile_kernels, median_log_of_spectra
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer

_ROUNDING = 600 * torch.finfo(torch.float64).eps
"""Median magnitude, as a share of what a white image has on average, that is nothing but rounding."""


def median_log_magnitude(images: Tensor) -> Tensor:
    """median(ln |FFT2(I)|) over all 3·H·W coefficients of each image: float64 [B] on the images' device.

    ``images`` [B, H, W, 3] are colours, clamped to [0, 1] as a display would. No window, no shift, no
    normalisation. −inf for images without structure (blank), NaN where a pixel is NaN. Raises
    ``InvalidInputError`` for another shape or type.
    """
    if images.ndim != 4 or images.shape[-1] != 3 or images.numel() == 0:
        raise InvalidInputError(f"Images must have shape [B, H, W, 3], not {list(images.shape)}.")
    if images.dtype not in {torch.float32, torch.float64}:
        raise InvalidInputError("Images must be float32 or float64, with colours in [0, 1].")
    height, width = images.shape[1:3]
    scores = median_log_of_spectra(images)
    return scores.masked_fill(scores < math.log(_ROUNDING * math.sqrt(height * width)), -math.inf)


@dataclass(frozen=True)
class MedianFrequency:
    """Scores a candidate by the median log-magnitude of what the model shows there, on black.

    The score is blind to missing coverage (90 % of a view unobserved lowers it less than 1 px of blur), so a
    view that the model fills by less than ``min_coverage`` is reported as ``low-coverage``, not ranked.
    """

    min_coverage: float = MIN_COVERAGE

    def __post_init__(self) -> None:
        check_min_coverage(self.min_coverage)

    @property
    def name(self) -> str:
        """See ``Scorer``."""
        return "median-frequency"

    def score(
        self,
        gaussians: Gaussians,
        candidates: Sequence[Candidate],
        rasterizer: Rasterizer,
        *,
        sh_degree: int | None = None,
        monitor: Monitor | None = None,
    ) -> tuple[CandidateScore, ...]:
        """See ``Scorer``."""
        if rasterizer.device.type == "cpu":
            compile_kernels(monitor)
        return score_renderings(
            median_log_magnitude,
            gaussians,
            candidates,
            rasterizer,
            min_coverage=self.min_coverage,
            sh_degree=sh_degree,
            monitor=monitor,
        )
