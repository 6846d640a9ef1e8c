"""Whether the blob store answers, for probes and metrics: checked rarely, with a short timeout."""

import threading
import time
from concurrent.futures import Future
from concurrent.futures import TimeoutError as WaitError

from fvs_service.errors import ServiceError, StorageUnavailableError
from fvs_service.storage.blobs import Blobs

_FRESH_S = 5.0
"""How long an answer is valid."""
_WITHIN_S = 3.0
"""A store that takes longer counts as unavailable: probes have short timeouts."""


class StoreCheck:
    """Checks the store on demand, one check at a time. Safe to use from any thread.

    While a store does not answer, only the first callers wait for it.
    """

    def __init__(self, blobs: Blobs, *, within_s: float = _WITHIN_S) -> None:
        self._blobs, self._within_s = blobs, within_s
        self._lock = threading.Lock()
        self._answer: Future[None] | None = None
        self._asked_at = 0.0

    def require(self) -> None:
        """Raise ``StorageUnavailableError`` unless the store answers, or has just answered."""
        try:
            answer, asked_at = self._current()
            answer.result(max(0.0, asked_at + self._within_s - time.monotonic()))
        except WaitError as error:
            raise StorageUnavailableError(
                f"The object store has not answered within {self._within_s:g} s.",
                hint="Try again soon. If the error persists, run fvs doctor, which reports the cause.",
                retry_after_s=5,
            ) from error

    def _current(self) -> tuple[Future[None], float]:
        """The answer, which may be pending, and the time of its request."""
        with self._lock:
            answer = self._answer
            if answer is None or (answer.done() and time.monotonic() - self._asked_at > _FRESH_S):
                answer = self._answer = Future()
                self._asked_at = time.monotonic()
                threading.Thread(target=self._ask, args=(answer,), daemon=True, name="store-check").start()
            return answer, self._asked_at

    def _ask(self, answer: "Future[None]") -> None:
        try:
            self._blobs.check()
        except ServiceError as error:
            answer.set_exception(error)
        except Exception as error:
            failure = StorageUnavailableError(
                "The object store cannot be used.", hint="Run fvs doctor.", retry_after_s=5
            )
            failure.__cause__ = error
            answer.set_exception(failure)
        else:
            answer.set_result(None)
