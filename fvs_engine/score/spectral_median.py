"""The spectral median: the frequency under which a rendered view keeps half of its energy.

Signal processing calls this the median frequency. The paper's score of that name is a median *magnitude*
(``median_frequency``); the two rank very differently.
"""

import math

import torch
from torch import Tensor

from fvs_engine.score.renderings import RenderingScorer, require_images

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
    require_images(images)
    height, width = images.shape[1:3]
    planes = images.movedim(-1, 1).to(torch.float64).clamp(0.0, 1.0)
    window = torch.outer(_hann(height, images.device), _hann(width, images.device))
    planes = planes - (planes * window).sum((-2, -1), keepdim=True) / window.sum()
    half = torch.fft.rfft2(planes * window)
    power = torch.view_as_real(half).square().sum((1, -1))
    # Columns of a real image's half spectrum count twice, except the first and an even width's last.
    power[..., 1 : (width + 1) // 2] *= 2
    rows = torch.fft.fftfreq(height, dtype=torch.float64, device=images.device)
    columns = torch.fft.rfftfreq(width, dtype=torch.float64, device=images.device)
    frequencies, order = torch.hypot(rows[:, None], columns[None]).flatten().sort()
    energy = power.flatten(1)[:, order].cumsum(dim=1)
    total = energy[:, -1:]
    reached = torch.searchsorted(energy, 0.5 * total).clamp_max(energy.shape[1] - 1)
    structured = total[:, 0] > _ROUNDING * (height * width) ** 2
    return frequencies[reached[:, 0]].where(structured, math.nan)


class SpectralMedian(RenderingScorer):
    """Scores a candidate by the spectral median of its render on black.

    A blurred render keeps its energy at low frequencies: the lowest ranks first. A view that the model
    fills by less than ``min_coverage`` is reported as ``low-coverage``: its energy is that of an outline.
    """

    name = "spectral-median"

    def measure(self, images: Tensor) -> Tensor:
        """See ``spectral_median_frequency``."""
        return spectral_median_frequency(images)


def _hann(size: int, device: torch.device) -> Tensor:
    """A Hann window with its zeros half a pixel outside, so that every pixel has weight."""
    centres = torch.arange(size, dtype=torch.float64, device=device) + 0.5
    return torch.sin(math.pi * centres / size).square()
