"""Code that differs from the synchronous client: sleeping, blocking and concurrent calls, over tasks.

``_sync/concurrency.py`` has the same functions over threads. Both are written by hand.
"""

from collections.abc import Awaitable, Callable, Iterable
from typing import TypeVar, TypeVarTuple

import anyio
import anyio.to_thread

A = TypeVar("A")
T = TypeVar("T")
Ts = TypeVarTuple("Ts")


async def sleep(seconds: float) -> None:
    """Sleep for ``seconds``."""
    await anyio.sleep(seconds)


async def run_blocking(function: Callable[[*Ts], T], *args: *Ts) -> T:
    """Return ``function(*args)``, computed in a thread."""
    return await anyio.to_thread.run_sync(function, *args)


async def map_concurrently(function: Callable[[A], Awaitable[T]], items: Iterable[A], limit: int) -> list[T]:
    """Call ``function`` for all items, at most ``limit`` at a time; return the results in order.

    The first error cancels the other calls and is raised.
    """
    items = list(items)
    results: dict[int, T] = {}
    errors: list[Exception] = []
    slots = anyio.Semaphore(max(1, limit))

    async def call(index: int, item: A) -> None:
        async with slots:
            try:
                results[index] = await function(item)
            except Exception as error:
                errors.append(error)
                group.cancel_scope.cancel()

    async with anyio.create_task_group() as group:
        for index, item in enumerate(items):
            group.start_soon(call, index, item)
    if errors:
        raise errors[0]
    return [results[index] for index in range(len(items))]
