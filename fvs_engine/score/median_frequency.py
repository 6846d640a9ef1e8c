"""The median frequency: how much fine detail a rendered view shows.

Source: the paper's released code. The score is the median log-magnitude of the render's spectrum, which in
practice measures detail near 0.4 cycles/px; blurred, hence badly reconstructed, views score low, come first.
"""

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import torch
from torch import Tensor

from fvs_engine.errors import InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.score.interface import Candidate, CandidateScore, CandidateStatus
from fvs_engine.score.spectrum_median import median_log_of_spectra
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer

_BATCH_PIXELS = 1 << 23
"""Pixels whose spectra a GPU computes at once; a CPU is busy with one image at a time."""


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

    min_coverage: float = 0.1

    def __post_init__(self) -> None:
        if not 0.0 <= self.min_coverage <= 1.0:
            raise InvalidInputError(f"min_coverage must be in [0, 1], not {self.min_coverage}.")

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
        monitor = monitor or Monitor()
        batches = _batches(candidates, rasterizer.device)
        scores: list[CandidateScore] = []
        for batch in batches:
            colors, alphas = [], []
            for candidate in batch:
                monitor.check()
                with torch.no_grad():
                    rendering = rasterizer.render(
                        gaussians, candidate.camera, candidate.camera_from_model, sh_degree=sh_degree
                    )
                colors.append(rendering.color)
                alphas.append(rendering.alpha.mean())
            values = median_log_magnitude(torch.stack(colors)).tolist()
            coverages = torch.stack(alphas).nan_to_num(nan=0.0).clamp(0.0, 1.0).tolist()
            scores += map(self._judge, (candidate.id for candidate in batch), values, coverages)
            monitor.report("score", len(scores), len(candidates))
        return tuple(scores)

    def _judge(self, candidate_id: str, value: float, coverage: float) -> CandidateScore:
        if coverage == 0.0 or not math.isfinite(value):
            return CandidateScore(candidate_id, None, CandidateStatus.OUT_OF_MODEL, coverage)
        covered = coverage >= self.min_coverage
        status = CandidateStatus.RANKED if covered else CandidateStatus.LOW_COVERAGE
        return CandidateScore(candidate_id, value, status, coverage)


def _batches(candidates: Sequence[Candidate], device: torch.device) -> Iterator[tuple[Candidate, ...]]:
    """Candidates in groups that the device can take at once; refuses images of different sizes."""
    sizes = {(candidate.camera.width, candidate.camera.height) for candidate in candidates}
    if len(sizes) > 1:
        raise InvalidInputError(
            "Scores of images of different sizes cannot be compared: "
            + ", ".join(f"{width} × {height}" for width, height in sorted(sizes))
            + ".",
            hint="Give all candidates one image size (PinholeCamera.resized).",
        )
    size = 1
    if device.type != "cpu" and sizes:
        width, height = sizes.pop()
        size = max(1, _BATCH_PIXELS // (width * height))
    remaining = iter(candidates)
    while batch := tuple(islice(remaining, size)):
        yield batch
