"""The warning when hardly any candidate can be registered."""

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
