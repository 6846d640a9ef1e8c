"""SIGTERM and SIGINT as an event, with a deadline that holds whatever the process is doing."""

import contextlib
import os
import select
import signal
import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Self

_SIGNALS = (signal.SIGTERM, signal.SIGINT)
_HANDLED = (*_SIGNALS, signal.SIGCHLD)
_EXIT_BY_SIGNAL = 128
"""Added to the number of the signal, as shells do."""


class StopSignals:
    """Set ``stopping`` on SIGTERM and SIGINT within a block of the main thread. SIGCHLD ends a ``wait``, too.

    A process that is still there ``within_s`` after the first signal, or at a second one, calls ``kill`` and
    ends. A thread of its own sees to that: handlers in Python run only between two steps of the main thread,
    which may be waiting for a database. The handlers also make signals reach process 1 of a container, which
    ignores those that it has no handler for.
    """

    def __init__(self, within_s: float, kill: Callable[[], object]) -> None:
        self._within_s, self._kill = within_s, kill
        self._stopping = threading.Event()
        self._woken = threading.Event()
        self._deadline: float | None = None

    def allow(self, more_s: float) -> None:
        """Wait this much longer for processes to end, from the next signal on."""
        self._within_s += more_s

    @property
    def stopping(self) -> bool:
        """Whether a signal has arrived."""
        return self._stopping.is_set()

    def wait(self, timeout_s: float) -> bool:
        """Wait for a signal, or for a child to end; returns whether there has been a signal."""
        self._woken.wait(timeout_s)
        self._woken.clear()
        return self.stopping

    def __enter__(self) -> Self:
        self._read, self._write = os.pipe()
        os.set_blocking(self._write, False)
        self._handlers = {number: signal.signal(number, lambda *_: None) for number in _HANDLED}
        self._wakeup = signal.set_wakeup_fd(self._write, warn_on_full_buffer=False)
        self._watcher = threading.Thread(target=self._watch, daemon=True, name="signals")
        self._watcher.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.set_wakeup_fd(self._wakeup)
        for number, handler in self._handlers.items():
            signal.signal(number, handler)
        os.close(self._write)
        self._watcher.join()
        os.close(self._read)

    def _watch(self) -> None:
        """Read the numbers of the signals, which the interpreter writes as they arrive."""
        while True:
            left_s = None if self._deadline is None else self._deadline - time.monotonic()
            if left_s is not None and left_s <= 0:
                self._end(signal.SIGTERM)
            if not select.select([self._read], [], [], left_s)[0]:
                continue
            numbers = os.read(self._read, 64)
            if not numbers:
                return
            for number in numbers:
                if number in _SIGNALS:
                    self._arrived(signal.Signals(number))
                self._woken.set()

    def _arrived(self, number: signal.Signals) -> None:
        if self.stopping:
            self._end(number)
        self._deadline = time.monotonic() + self._within_s
        self._stopping.set()

    def _end(self, number: signal.Signals) -> None:
        with contextlib.suppress(Exception):
            self._kill()
        os._exit(_EXIT_BY_SIGNAL + number)
