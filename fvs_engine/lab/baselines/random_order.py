"""Random order of the candidates: the baseline of all selectors."""

import hashlib

from fvs_engine.monitor import Monitor
from fvs_engine.score import CandidateScore
from fvs_engine.score.selectors.interface import SelectionContext
from fvs_schema.candidates import CandidateStatus


class RandomOrder:
    """Scores a candidate by a number in [0, 1) that depends only on the seed, the step and its name.

    A choice depends neither on the order of the candidates nor on earlier draws, so that a killed run
    continues identically. Score: random number, without meaning; 0 to 1. Source: the baseline of every paper.
    Cost: none.
    """

    name = "random"

    def score(
        self,
        context: SelectionContext,
        monitor: Monitor | None = None,  # noqa: ARG002 - over at once
    ) -> tuple[CandidateScore, ...]:
        """See ``Selector``."""
        return tuple(
            CandidateScore(
                candidate.name,
                _fraction(f"{context.seed}/{context.step}/{candidate.name}"),
                CandidateStatus.RANKED,
                None,
            )
            for candidate in context.candidates
        )


def _fraction(text: str) -> float:
    """A hash in [0, 1), with as many bits as a float holds."""
    return (int.from_bytes(hashlib.blake2b(text.encode(), digest_size=8).digest()) >> 11) / 2**53
