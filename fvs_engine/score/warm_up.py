"""Calls every kernel of the scores once, on next to nothing: see ``compilation.ahead``."""

from collections.abc import Callable

import torch

from fvs_engine.score.log_magnitude_median import median_log_of_spectra


def _median() -> None:
    draw = torch.Generator().manual_seed(0)
    for width in (16, 17):  # the second one is transposed
        median_log_of_spectra(torch.rand((1, 12, width, 3), generator=draw))


STEPS: tuple[Callable[[], None], ...] = (_median,)
