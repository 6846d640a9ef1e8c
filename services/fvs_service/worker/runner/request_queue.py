"""The queue of rankings and renderings: one at a time, before training."""

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

_LONGEST_PAUSE_S = 2.0
"""Training makes a step at least this often, however many requests arrive."""


class RequestQueue:
    """A queue, first in, first out, whose requests go before the training of the same runner.

    Each request uses all cores, so two at once would take twice as long and twice the memory.
    """

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._arrived = 0
        self._done = 0

    @contextmanager
    def turn(self) -> Iterator[float]:
        """Wait for all earlier requests, then run the block; yields the seconds that it waited."""
        arrived = time.monotonic()
        with self._changed:
            number, self._arrived = self._arrived, self._arrived + 1
            self._changed.wait_for(lambda: self._done == number)
        try:
            yield time.monotonic() - arrived
        finally:
            with self._changed:
                self._done += 1
                self._changed.notify_all()

    def wait_until_empty(self) -> None:
        """Wait until no request is left, but for 2 s at most."""
        if self._done == self._arrived:
            return
        with self._changed:
            self._changed.wait_for(lambda: self._done == self._arrived, _LONGEST_PAUSE_S)
