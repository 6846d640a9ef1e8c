"""Refused requests per API key: a key whose requests are refused again and again is put on hold.

Keys that were found to be wrong are remembered for a while: they never become valid.

A wrong request costs the gateway more than its sender. While a key is on hold, its requests that carry a body
are answered before that is read. What counts is in the request alone (``ServiceError.blames_request``), so a
client that sends right requests is never on hold: not when another changes what it works on, nor when its key
lacks a scope, nor when bytes are damaged on the way.
"""

import hashlib
import math
import time
from collections import deque
from collections.abc import Callable

import structlog

from fvs_service.errors import LimitExceededError, ServiceError, UnauthenticatedError
from fvs_service.principal import Principal
from fvs_service.telemetry import Metrics

_WINDOW_S = 60.0
_MOST_WRONG_KEYS = 10_000

_log = structlog.get_logger()


class Refusals:
    """Lets each key have ``limit`` refused requests within a minute; all calls are made on one event loop.

    Only keys that are valid are counted: nobody can put the key of another on hold, and their number is
    bounded.
    """

    def __init__(self, limit: int, metrics: Metrics, clock: Callable[[], float] = time.monotonic) -> None:
        self._limit, self._metrics, self._clock = limit, metrics, clock
        self._times: dict[bytes, deque[float]] = {}
        self._wrong: dict[bytes, tuple[float, UnauthenticatedError]] = {}

    def check(self, key: str, *, with_body: bool) -> None:
        """Raise ``UnauthenticatedError`` for a key that was found to be wrong within the last minute.

        Raises ``LimitExceededError`` for a request ``with_body`` while the key is on hold.
        """
        digest, now = _digest(key), self._clock()
        since, wrong = self._wrong.get(digest, (-math.inf, None))
        if wrong is not None and now < since + _WINDOW_S:
            raise UnauthenticatedError(wrong.message, hint=wrong.hint)
        left_s = self._left_s(digest, now)
        if not with_body or left_s <= 0:
            return
        self._metrics.held_requests.inc()
        raise LimitExceededError(
            f"{self._limit} requests of this API key were refused within {_WINDOW_S:g} s: it may not send "
            "bodies for a while.",
            hint="Fix the requests; see GET /openapi.json. The operator can raise "
            "FVS_LIMITS__REFUSALS_PER_KEY.",
            retry_after_s=math.ceil(left_s),
        )

    def count(self, key: str, principal: Principal | None, error: ServiceError) -> None:
        """Count a failed request if the request is to blame; ``principal`` is None where the key is wrong."""
        digest, now = _digest(key), self._clock()
        if principal is None:
            if isinstance(error, UnauthenticatedError):
                self._remember_wrong(digest, now, error)
            return
        if not error.blames_request or self._left_s(digest, now) > 0:  # which would prolong the hold
            return
        times = self._times.pop(digest, deque())
        while times and times[0] <= now - _WINDOW_S:
            times.popleft()
        times.append(now)
        self._times[digest] = times  # the last one
        self._forget(now - _WINDOW_S)
        if len(times) >= self._limit:
            self._metrics.holds.inc()
            _log.warning("key on hold", key_id=principal.key_id, refused=self._limit, last=error.message)

    def _remember_wrong(self, digest: bytes, now: float, error: UnauthenticatedError) -> None:
        self._wrong.pop(digest, None)
        self._wrong[digest] = now, UnauthenticatedError(error.message, hint=error.hint)  # without traceback
        if len(self._wrong) > _MOST_WRONG_KEYS:
            del self._wrong[next(iter(self._wrong))]

    def _left_s(self, digest: bytes, now: float) -> float:
        """Time left until the key is no longer on hold."""
        times = self._times.get(digest)
        return 0.0 if times is None or len(times) < self._limit else times[0] + _WINDOW_S - now

    def _forget(self, until: float) -> None:
        """Drop keys without a refusal since then."""
        while self._times[oldest := next(iter(self._times))][-1] <= until:
            del self._times[oldest]


def _digest(key: str) -> bytes:
    return hashlib.sha256(key.encode()).digest()
