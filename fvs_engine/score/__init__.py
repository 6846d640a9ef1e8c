"""Scores of candidate views, their feasibility, and the selectors that rank by them."""

from fvs_engine.candidates import CandidateScore
from fvs_engine.score.estimate.median_frequency_estimate import MedianFrequencyEstimate
from fvs_engine.score.interface import Scorer
from fvs_engine.score.median_frequency import MedianFrequency, median_log_magnitude
from fvs_engine.score.median_frequency_fast import MedianFrequencyFast
from fvs_engine.score.rank import rank
from fvs_engine.score.renderings import MIN_COVERAGE, check_min_coverage, judged
from fvs_engine.score.spectral_median import SpectralMedian, spectral_median_frequency

__all__ = [
    "MIN_COVERAGE",
    "CandidateScore",
    "MedianFrequency",
    "MedianFrequencyEstimate",
    "MedianFrequencyFast",
    "Scorer",
    "SpectralMedian",
    "check_min_coverage",
    "judged",
    "median_log_magnitude",
    "rank",
    "spectral_median_frequency",
]
