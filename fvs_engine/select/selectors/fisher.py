"""FisherRF: the view that says most about what the visited views say least about."""

import torch
from torch import Tensor

from fvs_engine.score import MIN_COVERAGE
from fvs_engine.select.information_gain import InformationGain


def fisher() -> InformationGain:
    """Largest trace of H_candidate · (H_visited + λ)⁻¹ first, with diagonal H (``InformationGain``).

    Source: Jiang, Lei, Daniilidis, "FisherRF: Active View Selection and Mapping with Radiance Fields Using
    Fisher Information", ECCV 2024. Cost: one gradient per candidate and per
    visited view.
    """
    return InformationGain("fisher", trace_ratio, MIN_COVERAGE)


def trace_ratio(information: Tensor, known: Tensor) -> Tensor:
    """Σ H / K over all entries, added up in float64. It grows without bound where K is small."""
    return (information / known).sum(dtype=torch.float64)
