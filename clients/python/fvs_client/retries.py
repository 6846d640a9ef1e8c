"""When a request is sent again, and after which pause."""

import random
from collections.abc import Callable
from dataclasses import dataclass

from fvs_client.errors import (
    ApiError,
    ConnectionFailedError,
    DeadlineExceededError,
    DigestMismatchError,
    FvsError,
)

_TRANSIENT = frozenset({408, 429, 500, 502, 503, 504})


@dataclass(frozen=True)
class Retries:
    """Repeatable requests are sent up to ``attempts`` times, all within about ``within_s``.

    Pauses have full jitter: uniform between 0 and ``first_s`` · 2ⁿ, at most ``longest_s``, so that clients
    that failed together do not return together. A ``Retry-After`` of the service is added.
    """

    attempts: int = 5
    first_s: float = 0.5
    longest_s: float = 8.0
    within_s: float = 60.0
    draw: Callable[[], float] = random.random
    """Uniform in [0, 1)."""

    def pause_s(self, error: FvsError, attempt: int, elapsed_s: float) -> float | None:
        """The pause in s after the failed ``attempt`` (the first is 1); None to give up."""
        if attempt >= self.attempts or not _is_transient(error):
            return None
        pause = self.draw() * min(self.longest_s, self.first_s * 2.0 ** (attempt - 1))
        if isinstance(error, ApiError) and error.retry_after_s is not None:
            pause += error.retry_after_s
        return pause if elapsed_s + pause <= self.within_s else None


NO_RETRIES = Retries(attempts=1)


def _is_transient(error: FvsError) -> bool:
    if isinstance(error, ConnectionFailedError | DigestMismatchError):
        return True
    if isinstance(error, DeadlineExceededError):  # the caller's time is over
        return False
    return isinstance(error, ApiError) and error.status in _TRANSIENT and error.retryable
