"""Warnings when hardly any candidate can be photographed, or registered."""

from collections import Counter
from collections.abc import Iterable

from fvs_schema.candidates import CandidateStatus

NEARER = "Give candidates nearer to the images: at most 15° from one to the next, as seen from the scene."
"""The remedy."""
_FEW = 3


def few_registrable(registrable: int | None, candidates: int) -> str | None:
    """The message when fewer than three of ``candidates`` are ``registrable``.

    None when more are, or when it was not computed (``registrable`` None).
    """
    if registrable is None or registrable >= min(_FEW, candidates):
        return None
    how_many = f"Only {registrable}" if registrable else "None"
    return (
        f"{how_many} of the {candidates} candidates {'are' if registrable > 1 else 'is'} likely to be "
        "registered: they see little of what the images show, or see it from too far aside."
    )


ELSEWHERE = "Give candidates farther from matter, and as near to the images as these are to each other."
"""The remedy where candidates are not feasible."""
_AGAINST = {
    CandidateStatus.IN_MATTER: "inside matter",
    CandidateStatus.TOO_CLOSE: "too close to matter",
    CandidateStatus.NO_FLY: "in a no-fly zone",
    CandidateStatus.OUT_OF_MODEL: "out of the model",
    CandidateStatus.UNREGISTRABLE: "unlikely to be registered",
}


def none_feasible(statuses: Iterable[CandidateStatus]) -> str | None:
    """The message when something is against every candidate; None when it is not, or there is none."""
    counts = Counter(statuses)
    if not counts or counts.keys() - _AGAINST.keys():
        return None
    reasons = ", ".join(
        f"{counts[status]:,} {reason}" for status, reason in _AGAINST.items() if counts[status]
    )
    return f"None of the {counts.total():,} candidates is feasible: {reasons}."
