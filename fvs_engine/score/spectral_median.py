"""The spectral median: the frequency under which a rendered view keeps half of its energy.

What signal processing calls the median frequency. Not the paper's score, which is a median *magnitude*
(``median_frequency``); the two rank very differently.
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
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer

_ROUNDING = 1e-12
"""Mean square of the windowed colours under which an image has no structure but rounding (8 bits: 1e-6)."""


def spectral_median_frequency(images: Tensor) -> Tensor:
    """The radial frequency that halves each image's energy, in cycles/px: float64 [B] on their device.

    ``images`` [B, H, W, 3] are colours, clamped to [0, 1]. Every channel loses its mean (weighted by the
    window, so that nothing is left at frequency 0) and is weighted by a Hann window (so that opposite
    borders that differ are no edge). Power |F|² of the three channels is added up in the order of
    √(f_x² + f_y²), f in cycles/px; the answer is the first frequency at which the sum reaches half, up to
    √½. NaN for images without structure (blank) or with a NaN. Raises ``InvalidInputError`` for another
    shape or type.
    """
    if images.ndim != 4 or images.shape[-1] != 3 or images.numel() == 0:
        raise InvalidInputError(f"Images must have shape [B, H, W, 3], not {list(images.shape)}.")
    if images.dtype not in {torch.float32, torch.float64}:
        raise InvalidInputError("Images must be float32 or float64, with colours in [0, 1].")
    height, width = images.shape[1:3]
    planes = images.movedim(-1, 1).to(torch.float64).clamp(0.0, 1.0)
    window = torch.outer(_hann(height, images.device), _hann(width, images.device))
    planes = planes - (planes * window).sum((-2, -1), keepdim=True) / window.sum()
    half = torch.fft.rfft2(planes * window)
    power = torch.view_as_real(half).square().sum((1, -1))
    # The columns of a real image's half spectrum stand for two, but for the first and an even width's last.
    power[..., 1 : (width + 1) // 2] *= 2
    rows = torch.fft.fftfreq(height, dtype=torch.float64, device=images.device)
    columns = torch.fft.rfftfreq(width, dtype=torch.float64, device=images.device)
    frequencies, order = torch.hypot(rows[:, None], columns[None]).flatten().sort()
    energy = power.flatten(1)[:, order].cumsum(dim=1)
    total = energy[:, -1:]
    reached = torch.searchsorted(energy, 0.5 * total).clamp_max(energy.shape[1] - 1)
    structured = total[:, 0] > _ROUNDING * (height * width) ** 2
    return frequencies[reached[:, 0]].where(structured, math.nan)


@dataclass(frozen=True)
class SpectralMedian:
    """Scores a candidate by the spectral median of what the model shows there, on black.

    A blurred render keeps its energy at low frequencies: the lower, the sooner. A view that the model
    fills by less than ``min_coverage`` is reported as ``low-coverage``: its energy is that of an outline.
    """

    min_coverage: float = MIN_COVERAGE

    def __post_init__(self) -> None:
        check_min_coverage(self.min_coverage)

    @property
    def name(self) -> str:
        """See ``Scorer``."""
        return "spectral-median"

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
        return score_renderings(
            spectral_median_frequency,
            gaussians,
            candidates,
            rasterizer,
            min_coverage=self.min_coverage,
            sh_degree=sh_degree,
            monitor=monitor,
        )


def _hann(size: int, device: torch.device) -> Tensor:
    """A Hann window whose zeros lie half a pixel outside: no pixel is lost, and a single one weighs 1."""
    centres = torch.arange(size, dtype=torch.float64, device=device) + 0.5
    return torch.sin(math.pi * centres / size).square()
