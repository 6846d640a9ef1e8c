"""Limits on what a tenant may do at the same time."""

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from fvs_service.errors import LimitExceededError


class ConcurrencyLimit:
    """Allows each tenant ``limit`` operations at a time in this process; ``what`` names them in messages."""

    def __init__(self, what: str, limit: int) -> None:
        self._what, self._limit = what, limit
        self._lock = threading.Lock()
        self._used: Counter[str] = Counter()

    @contextmanager
    def slot(self, tenant_id: str) -> Iterator[None]:
        """Occupy one of the tenant's slots for the block; raises ``LimitExceededError`` when none is free."""
        with self._lock:
            if self._used[tenant_id] >= self._limit:
                raise LimitExceededError(
                    f"{self._limit} {self._what} are open, and no more are allowed at once.", retry_after_s=1
                )
            self._used[tenant_id] += 1
        try:
            yield
        finally:
            with self._lock:
                self._used[tenant_id] -= 1
