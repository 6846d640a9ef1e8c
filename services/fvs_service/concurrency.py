"""Limits on what a tenant may do at the same time."""

import asyncio
import math
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from weakref import WeakValueDictionary

from fvs_service.errors import LimitExceededError

_WEIGHT = 0.3
"""Weight of the newest duration in the moving average."""
_LONGEST_WAIT_S = 60.0


class ConcurrencyLimit:
    """Allows each tenant ``limit`` operations at a time in this process; ``what`` names them in messages.

    ``Retry-After`` is when the oldest of them should end, by the average time that they take.
    """

    def __init__(self, what: str, limit: int) -> None:
        self._what, self._limit = what, limit
        self._lock = threading.Lock()
        self._started: defaultdict[str, dict[object, float]] = defaultdict(dict)
        self._average_s = 0.0

    @contextmanager
    def slot(self, tenant_id: str) -> Iterator[None]:
        """Occupy one of the tenant's slots during the block; raises ``LimitExceededError`` without one."""
        operation, started = object(), time.monotonic()
        with self._lock:
            theirs = self._started[tenant_id]
            if len(theirs) >= self._limit:
                left_s = min(theirs.values()) + self._average_s - started
                raise LimitExceededError(
                    f"{self._limit} {self._what} are open, and no more are allowed at once.",
                    retry_after_s=max(1, math.ceil(min(left_s, _LONGEST_WAIT_S))),
                )
            theirs[operation] = started
        try:
            yield
        finally:
            with self._lock:
                took_s = time.monotonic() - theirs.pop(operation)
                self._average_s += _WEIGHT * (took_s - self._average_s)
                if not theirs:
                    self._started.pop(tenant_id, None)


class TenantTurns:
    """Allows each tenant ``limit`` operations at a time; others wait on the event loop, in their order."""

    def __init__(self, limit: int) -> None:
        self._limit = limit
        self._turns: WeakValueDictionary[str, asyncio.Semaphore] = WeakValueDictionary()

    async def begin(self, tenant_id: str) -> asyncio.Semaphore:
        """Wait for a turn, which lasts until the result is released."""
        turns = self._turns.get(tenant_id)
        if turns is None:
            turns = self._turns[tenant_id] = asyncio.Semaphore(self._limit)
        await turns.acquire()
        return turns
