"""The two hand-written halves of the client's concurrency behave alike."""

import threading
import time
from collections.abc import Callable
from functools import partial

import anyio
import pytest
from fvs_client._async import concurrency as tasks
from fvs_client._sync import concurrency as threads


class FailedError(Exception):
    pass


class Work:
    """Counts how many calls run at a time; the call ``failing`` fails, and the later ones sleep long."""

    def __init__(self, failing: int | None = None) -> None:
        self._failing = failing
        self._lock = threading.Lock()
        self._running = 0
        self.most = 0
        self.begun: list[int] = []

    def begin(self, item: int) -> float:
        """Count a call that begins; return how long it sleeps."""
        with self._lock:
            self._running += 1
            self.most = max(self.most, self._running)
            self.begun.append(item)
        if item == self._failing:
            raise FailedError(item)
        return 0.02 * (3 - item % 3) if self._failing is None else 60.0

    def end(self, item: int) -> int:
        with self._lock:
            self._running -= 1
        return item * item


def in_threads(work: Work, count: int, limit: int) -> list[int]:
    def call(item: int) -> int:
        threads.sleep(work.begin(item))
        return work.end(item)

    return threads.map_concurrently(call, range(count), limit)


def in_tasks(work: Work, count: int, limit: int) -> list[int]:
    async def call(item: int) -> int:
        await tasks.sleep(work.begin(item))
        return work.end(item)

    return anyio.run(partial(tasks.map_concurrently, call, range(count), limit))


both = pytest.mark.parametrize("run", [in_threads, in_tasks])


@both
def test_results_are_in_order_and_no_more_run_than_may(run: Callable[..., list[int]]) -> None:
    work = Work()
    assert run(work, 12, 4) == [item * item for item in range(12)]
    assert 1 < work.most <= 4


@both
@pytest.mark.parametrize(("count", "limit"), [(0, 4), (1, 4), (3, 1)])
def test_one_at_a_time_is_fine_too(run: Callable[..., list[int]], count: int, limit: int) -> None:
    work = Work()
    assert run(work, count, limit) == [item * item for item in range(count)]
    assert work.most == min(count, 1)


@both
def test_the_first_error_wakes_the_sleeping_and_starts_no_more(run: Callable[..., list[int]]) -> None:
    work = Work(failing=1)
    began = time.monotonic()
    with pytest.raises(FailedError):
        run(work, 50, 2)
    assert time.monotonic() - began < 30
    assert len(work.begun) < 5


def test_blocking_calls_of_the_async_half_leave_the_event_loop() -> None:
    async def main() -> tuple[int, int]:
        return await tasks.run_blocking(threading.get_ident), threading.get_ident()

    worker, loop = anyio.run(main)
    assert worker != loop
    assert threads.run_blocking(threading.get_ident) == threading.get_ident()
