"""Selectors that score renders of the candidates only."""

from dataclasses import dataclass

from fvs_engine.monitor import Monitor
from fvs_engine.score import (
    CandidateScore,
    MedianFrequency,
    MedianFrequencyEstimate,
    MedianFrequencyFast,
    Scorer,
    SpectralMedian,
)
from fvs_engine.score.selectors.interface import SelectionContext


@dataclass(frozen=True)
class ScorerSelector:
    """A scorer as a selector of the same name."""

    scorer: Scorer

    @property
    def name(self) -> str:
        """See ``Selector``."""
        return self.scorer.name

    def score(self, context: SelectionContext, monitor: Monitor | None = None) -> tuple[CandidateScore, ...]:
        """See ``Selector``; candidates must have images of one size."""
        return self.scorer.score(
            context.gaussians,
            context.candidates,
            context.rasterizer,
            sh_degree=context.sh_degree,
            monitor=monitor,
        )


def median_frequency() -> ScorerSelector:
    """The paper's selector: lowest median log-magnitude of the render's spectrum first (``MedianFrequency``).

    Score: natural logarithm of the median magnitude in the spectrum, no unit; any number, mostly −6 to 4.
    Source: the paper, Algorithm 1. Cost: a render and an FFT per candidate; none for visited views.
    """
    return ScorerSelector(MedianFrequency())


def median_frequency_fast() -> ScorerSelector:
    """The paper's selector, exact for the first ten candidates only (``MedianFrequencyFast``).

    Score: natural logarithm of the median magnitude in the spectrum, no unit; any number, mostly −6 to 4.
    Cost: an estimate per candidate, a tenth of a render, and a render and an FFT of some dozens.
    """
    return ScorerSelector(MedianFrequencyFast())


def median_frequency_estimate() -> ScorerSelector:
    """The paper's selector without a render: all scores are estimates (``MedianFrequencyEstimate``).

    Score: natural logarithm of the median magnitude in the spectrum, no unit; any number, off by about
    the same for all candidates.
    Source: the outlook of the paper, which suggests one. Cost: a tenth of a render per candidate.
    """
    return ScorerSelector(MedianFrequencyEstimate())


def spectral_median() -> ScorerSelector:
    """Lowest energy-median frequency of the render first (``SpectralMedian``).

    Score: frequency below which half of the energy lies, in cycles per pixel; 0 to 0.71.
    Source: the textbook definition of a median frequency, beside the paper's score of nearly the same name.
    Cost: a render and an FFT per candidate; none for visited views.
    """
    return ScorerSelector(SpectralMedian())
