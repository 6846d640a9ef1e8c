"""Problem documents (RFC 9457)."""

from fvs_schema.base import Output


class ProblemField(Output):
    """A part of the request that is invalid."""

    field: str
    """Where it is, such as `candidates.3.id`."""
    message: str
    """What is wrong with it."""


class Problem(Output):
    """Why a request failed."""

    type: str = "about:blank"
    """Always `about:blank`: `code` identifies the problem."""
    title: str = ""
    """The kind of the problem, for people."""
    status: int
    """The HTTP status."""
    code: str
    """Stable, for programs."""
    detail: str = ""
    """What is wrong, in a sentence."""
    hint: str = ""
    """What to do about it."""
    retryable: bool = False
    """Whether the same request can succeed later."""
    request_id: str = ""
    """The request's id, which logs have, too."""
    errors: tuple[ProblemField, ...] = ()
    """The parts of the request that are invalid, where that is known."""
