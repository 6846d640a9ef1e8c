"""Code that differs from the asynchronous client: sleeping, blocking and concurrent calls, over threads.

``_async/concurrency.py`` has the same functions over tasks. Both are written by hand.
"""

import threading
import time
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_EXCEPTION, ThreadPoolExecutor, wait
from contextvars import ContextVar
from typing import TypeVar, TypeVarTuple

A = TypeVar("A")
T = TypeVar("T")
Ts = TypeVarTuple("Ts")

_stopped: ContextVar[threading.Event | None] = ContextVar("_stopped", default=None)
"""Set once another call of the same ``map_concurrently`` has failed; None outside of one."""


class _StoppedError(Exception):
    """Another call of the same ``map_concurrently`` has failed."""


def sleep(seconds: float) -> None:
    """Sleep for ``seconds``; inside ``map_concurrently`` an error of another call ends the sleep."""
    stopped = _stopped.get()
    if stopped is None:
        time.sleep(seconds)
    elif stopped.wait(seconds):
        raise _StoppedError


def run_blocking(function: Callable[[*Ts], T], *args: *Ts) -> T:
    """Return ``function(*args)``."""
    return function(*args)


def map_concurrently(function: Callable[[A], T], items: Iterable[A], limit: int) -> list[T]:
    """Call ``function`` for all items, at most ``limit`` at a time; return the results in order.

    The first error cancels the calls that have not begun, wakes those that sleep, and is raised.
    """
    items = list(items)
    if min(len(items), limit) <= 1:
        return [function(item) for item in items]
    stopped = threading.Event()
    with ThreadPoolExecutor(min(len(items), limit), "fvs-client", _stopped.set, (stopped,)) as pool:
        futures = [pool.submit(function, item) for item in items]
        try:
            wait(futures, return_when=FIRST_EXCEPTION)
            errors = [error for future in futures if future.done() and (error := future.exception())]
            if errors:
                raise errors[0]
            return [future.result() for future in futures]
        finally:  # also after Ctrl-C, which interrupts the wait
            stopped.set()
            pool.shutdown(wait=False, cancel_futures=True)
