"""The number of threads for kernels that run step after step, chosen by their time.

The threads of a kernel wait for each other at its end. Alone on two cores, steps of a quick model take 0.7 of
the time that they take with one thread. Beside a process of the same priority that keeps one core busy they
take twice as long, because the scheduler delays the second thread.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numba

_TRY_EVERY = 12
"""One in this many steps uses the other number of threads."""
_NEWEST = 0.2
"""Weight of the newest step in the smoothed time: two threads are slow now and then, and then very slow."""
_NEWEST_TRIAL = 0.5
_LONGEST = 10.0
"""Smoothed times after which a step counts no longer: the first one of all may load images."""
_FASTER = 0.95
"""Ratio of the times below which the other number of threads is used from then on."""


class FasterThreads:
    """Runs steps with one thread or with all that kernels may use here, whichever took less time lately.

    For kernels whose results are the same for any number of threads.
    """

    def __init__(self, clock: Callable[[], float] = time.perf_counter) -> None:
        self._all = numba.get_num_threads()
        self._clock = clock
        self._threads = self._all
        self._steps = 0
        self._smooth_s: float | None = None
        """Time of a step with the present number of threads."""
        self._ratio: float | None = None
        """Time of a step with the other number, in shares of that."""

    @contextmanager
    def step(self) -> Iterator[None]:
        """Run one step, the code in the block."""
        self._steps += 1
        trial = self._smooth_s is not None and self._steps % _TRY_EVERY == 0
        before, started = numba.get_num_threads(), self._clock()
        numba.set_num_threads(self._other if trial else self._threads)
        try:
            yield
        finally:
            numba.set_num_threads(before)
            self._add(self._clock() - started, trial)

    @property
    def _other(self) -> int:
        return 1 if self._threads == self._all else self._all

    def _add(self, seconds: float, trial: bool) -> None:
        if self._smooth_s is None:
            self._smooth_s = seconds
            return
        seconds = min(seconds, _LONGEST * self._smooth_s)
        if not trial:
            self._smooth_s += _NEWEST * (seconds - self._smooth_s)
            return
        ratio = seconds / self._smooth_s
        self._ratio = ratio if self._ratio is None else self._ratio + _NEWEST_TRIAL * (ratio - self._ratio)
        if self._ratio < _FASTER:
            self._threads = self._other
            self._smooth_s *= self._ratio
            self._ratio = 1.0 / self._ratio
