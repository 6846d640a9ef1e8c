"""The median frequency of signal processing as a selector: energy at the lowest frequencies first."""

from fvs_engine.score import SpectralMedian
from fvs_engine.select.scorer_selector import ScorerSelector


def spectral_median() -> ScorerSelector:
    """Lowest energy-median frequency of the render first (``fvs_engine.score.spectral_median``).

    Source: the textbook definition, as a counterpart to the paper's score of nearly the same name. Cost: a
    render and an FFT per candidate; none for visited views.
    """
    return ScorerSelector(SpectralMedian())
