"""How much of something a tenant may use at once."""

import threading
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager

from fvs_service.errors import LimitExceededError


class AtOnce:
    """Counts what is going on per tenant, in this process, and refuses what exceeds ``limit``."""

    def __init__(self, what: str, limit: int) -> None:
        self._what, self._limit = what, limit
        self._lock = threading.Lock()
        self._used: Counter[str] = Counter()

    @contextmanager
    def use(self, tenant_id: str) -> Iterator[None]:
        """Take one place while the block runs; raises ``LimitExceededError`` when all are taken."""
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
