"""From scores to a ranking."""

import math
from collections import Counter
from collections.abc import Iterable, Mapping

from fvs_engine.candidates import CandidateScore, RankedCandidate
from fvs_engine.errors import InvalidInputError
from fvs_schema.candidates import CandidateStatus

_ORDER = (CandidateStatus.RANKED, CandidateStatus.LOW_COVERAGE, CandidateStatus.OUT_OF_MODEL)


def rank(
    scores: Iterable[CandidateScore], distances: Mapping[str, float] | None = None
) -> tuple[RankedCandidate, ...]:
    """Order candidates: the lowest score first, ties by distance, then by name.

    Only candidates with status ``ranked`` get a rank; those of low coverage and those out of the model
    follow, in the same order among themselves. ``distances`` maps names to distances; candidates without one
    count as farthest in a tie. Raises ``InvalidInputError`` for a name that occurs twice and a distance that
    is negative or not finite.
    """
    known = dict(distances or {})
    scored = list(scores)
    repeated = [name for name, count in Counter(score.name for score in scored).items() if count > 1]
    if repeated:
        raise InvalidInputError(f"Candidate {repeated[0]} occurs more than once.")
    for name, distance in known.items():
        if not (math.isfinite(distance) and distance >= 0):
            raise InvalidInputError(f"The distance to candidate {name} cannot be {distance}.")

    def order(score: CandidateScore) -> tuple[int, float, float, str]:
        value = 0.0 if score.score is None else score.score
        return _ORDER.index(score.status), value, known.get(score.name, math.inf), score.name

    return tuple(
        RankedCandidate(
            rank=position if score.status is CandidateStatus.RANKED else None,
            name=score.name,
            score=score.score,
            status=score.status,
            coverage=score.coverage,
            distance=known.get(score.name),
            estimated=score.estimated,
        )
        for position, score in enumerate(sorted(scored, key=order), start=1)
    )
