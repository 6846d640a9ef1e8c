"""Scored and ranked candidates; importable without torch, which the service's gateway does not load."""

import math
from dataclasses import dataclass

from fvs_engine.errors import InvalidInputError
from fvs_schema.candidates import CandidateStatus


@dataclass(frozen=True)
class CandidateScore:
    """The score of one candidate: the lowest ``score`` ranks first.

    ``score`` is finite, and None exactly when the candidate is out of the model. ``coverage`` in [0, 1] is
    the mean alpha of the view: the share of it that the model fills; None where nothing was rendered.
    ``estimated``: the score was predicted, not measured. Raises ``InvalidInputError`` otherwise.
    """

    name: str
    score: float | None
    status: CandidateStatus
    coverage: float | None
    estimated: bool = False

    def __post_init__(self) -> None:
        if (self.score is None) != (self.status is CandidateStatus.OUT_OF_MODEL):
            raise InvalidInputError(f"Candidate {self.name}: no score if and only if it is out of the model.")
        if self.score is not None and not math.isfinite(self.score):
            raise InvalidInputError(f"Candidate {self.name}: a score must be finite, not {self.score}.")
        if self.coverage is not None and not 0.0 <= self.coverage <= 1.0:
            raise InvalidInputError(
                f"Candidate {self.name}: coverage must be in [0, 1], not {self.coverage}."
            )


@dataclass(frozen=True)
class RankedCandidate:
    """One candidate of a ranking.

    ``rank`` counts from 1; None for candidates that cannot be compared (see ``status``). ``score``: lower
    ranks first; None when it was not scored. ``coverage`` in [0, 1]: None when it was not rendered.
    ``distance``: how far the camera travels, in the caller's unit; None when it is not known.
    ``estimated``: the score was predicted, not measured. ``chance``: the probability that its photograph is
    registered; None where that was not computed, or poses are known.
    """

    rank: int | None
    name: str
    score: float | None
    status: CandidateStatus
    coverage: float | None
    distance: float | None = None
    estimated: bool = False
    chance: float | None = None
