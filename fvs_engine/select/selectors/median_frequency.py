"""The paper's selector: the most blurred view first."""

from fvs_engine.score import MedianFrequency
from fvs_engine.select.scorer_selector import ScorerSelector


def median_frequency() -> ScorerSelector:
    """Lowest median log-magnitude of the render's spectrum first (``fvs_engine.score.median_frequency``).

    Source: the paper, Algorithm 1. Cost: a render and an FFT per candidate; none for visited views.
    """
    return ScorerSelector(MedianFrequency())
