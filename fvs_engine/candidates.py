"""Ranked candidates of a ranking; importable without torch, which the service's gateway does not load."""

from dataclasses import dataclass
from enum import StrEnum


class CandidateStatus(StrEnum):
    """Whether a candidate has a rank and, if not, why."""

    RANKED = "ranked"
    VISITED = "visited"
    """An image was taken from this pose already."""
    OUT_OF_RANGE = "out-of-range"
    """Farther from the current pose than the radius."""
    OUT_OF_MODEL = "out-of-model"
    """Nothing of the model is in view."""
    LOW_COVERAGE = "low-coverage"
    """The model fills so little of the view that the score describes mostly the empty background."""


@dataclass(frozen=True)
class RankedCandidate:
    """One candidate of a ranking.

    ``rank`` counts from 1; None for candidates that cannot be compared (see ``status``). ``score``: lower
    ranks first; None when it was not scored. ``coverage`` in [0, 1]: None when it was not rendered.
    ``distance``: how far the camera travels, in the caller's unit; None when it is not known.
    """

    rank: int | None
    name: str
    score: float | None
    status: CandidateStatus
    coverage: float | None
    distance: float | None = None
