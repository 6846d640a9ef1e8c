"""The meaning of an answer of the service: success, a transient failure, or a refusal."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from email.utils import parsedate_to_datetime
from typing import Any

from fvs_client.spool.errors import LinkError
from fvs_client.spool.photograph import Refusal

_PASSING = frozenset({408, 423, 425, 429})
_OF_THE_KEY = frozenset({401, 403})
_LONGEST_RETRY_AFTER_S = 3_600.0
"""A clock that jumps at the other side, or a broken proxy, must not silence a device for days."""
DAMAGED = "digest-mismatch"
"""Codes for bytes that were damaged on the way, or are not those that were added: the sender knows which."""


@dataclass(frozen=True)
class Answer:
    """An answer; names of headers are in lower case."""

    status: int
    headers: Mapping[str, str]
    content: bytes
    early: bool = False
    """It came before the end of the request, which was not sent to its end."""

    @property
    def document(self) -> dict[str, Any] | None:
        """The JSON object in it; None when there is none, as in a login page of a network."""
        try:
            found = json.loads(self.content)
        except ValueError:
            return None
        return found if isinstance(found, dict) else None


class RefusedError(Exception):
    """The service refuses this request, and would again."""

    def __init__(self, status: int, refusal: Refusal) -> None:
        super().__init__(refusal.reason)
        self.status = status
        self.refusal = refusal


def require_success(answer: Answer) -> Answer:
    """Return an answer of 2xx; raise ``LinkError`` for transient failures, ``RefusedError`` for others.

    Only the service's own problem documents refuse: anything else is something in between, such as a proxy
    without its service or a network that wants a login. A key that is not accepted is no refusal of this
    photograph.
    """
    if 200 <= answer.status < 300:
        return answer
    problem = answer.document or {}
    own = isinstance(problem.get("code"), str) and problem.get("status") == answer.status
    if not own:
        raise LinkError(
            f"The answer is {answer.status}, and not from an fvs service.",
            hint="Is the URL right, and does a proxy or a login page of the network answer in its place?",
            answered=True,
            retry_after_s=_retry_after_s(answer.headers),
        )
    code, hint = str(problem["code"]), str(problem.get("hint") or "")
    message = str(problem.get("detail") or problem.get("title") or answer.status)
    passes = problem.get("retryable") is True or answer.status in _PASSING or answer.status >= 500
    if (passes and code != DAMAGED) or answer.status in _OF_THE_KEY:
        raise LinkError(message, hint=hint, answered=True, retry_after_s=_retry_after_s(answer.headers))
    raise RefusedError(answer.status, Refusal(code, message, hint))


def _retry_after_s(headers: Mapping[str, str]) -> float:
    """``Retry-After`` (RFC 9110, section 10.2.3) in s, an hour at most; a date is measured by its clock."""
    value = headers.get("retry-after", "").strip()
    if value.isascii() and value.isdigit():
        return min(float(value), _LONGEST_RETRY_AFTER_S)
    try:
        until, now = parsedate_to_datetime(value), parsedate_to_datetime(headers.get("date", ""))
        return min(max(0.0, (until - now).total_seconds()), _LONGEST_RETRY_AFTER_S)
    except (ValueError, TypeError):  # TypeError: one of the two has no time zone
        return 0.0
