"""Scores of candidate views: which one should be photographed next."""

from fvs_engine.score.interface import Candidate, CandidateScore, CandidateStatus, Scorer
from fvs_engine.score.median_frequency import MedianFrequency, median_log_magnitude
from fvs_engine.score.rank import RankedCandidate, rank

__all__ = [
    "Candidate",
    "CandidateScore",
    "CandidateStatus",
    "MedianFrequency",
    "RankedCandidate",
    "Scorer",
    "median_log_magnitude",
    "rank",
]
