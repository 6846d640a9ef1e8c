"""The dispatcher's loop, with queues that fail, and that have a job later."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import cast

import pytest
from fvs_service.host.worker.dispatcher import Dispatcher
from fvs_service.host.worker.runners import RunnerRequests
from fvs_service.jobs.queue import JobQueue
from fvs_service.jobs.states import Turn
from sqlalchemy.exc import OperationalError

from fvs_schema.jobs import JobKind

_WITHIN_S = 30


class BrokenQueue:
    """Fails when it is first asked for a job, then has one."""

    def __init__(self, error: Exception) -> None:
        self._answers = iter([error, Turn("job", "scene", JobKind.UPDATE, 1, "worker-0")])

    def taken_by(self, _worker_id: str) -> tuple[Turn, ...]:
        return ()

    def take(self, _worker_id: str) -> Turn | None:
        answer = next(self._answers, None)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def put_back(self, *_: object) -> None:
        pass


class LaterQueue(BrokenQueue):
    """Has no job until ``job`` is set, and then has it once; ``asked`` is set when it was first asked."""

    def __init__(self) -> None:
        self.asked = threading.Event()
        self.job: Turn | None = None

    def take(self, _worker_id: str) -> Turn | None:
        job, self.job = self.job, None
        self.asked.set()
        return job


class QuickQueue(BrokenQueue):
    """Has a job whose second turn is taken before the thread of the first one has ended."""

    def __init__(self, wake: Callable[[], None]) -> None:
        self._wake = wake
        self._waiting = [Turn("job", "scene", JobKind.UPDATE, 1, "worker-0")]
        self._taken: list[Turn] = []
        self._taken_again = threading.Event()
        self._turns = 0

    def taken_by(self, _worker_id: str) -> tuple[Turn, ...]:
        return tuple(self._taken)

    def take(self, _worker_id: str) -> Turn | None:
        if not self._waiting:
            return None
        turn = self._waiting.pop()
        self._taken.append(turn)
        self._turns += 1
        if self._turns == 2:
            self._taken_again.set()
        return turn

    def put_back(self, turn: Turn, *_: object) -> None:
        self._taken.remove(turn)
        if self._turns == 1:
            self._waiting.append(turn)
            self._wake()
            assert self._taken_again.wait(_WITHIN_S)
            time.sleep(0.1)  # until the dispatcher has looked at it


@contextmanager
def _dispatching(
    queue: object, ran: threading.Event | Callable[[Turn], None], poll_s: float, slots: int = 1
) -> Iterator[Dispatcher]:
    run = (lambda _ticket: ran.set()) if isinstance(ran, threading.Event) else ran
    dispatcher = Dispatcher(
        "worker-0",
        cast(JobQueue, queue),
        cast(RunnerRequests, SimpleNamespace(take=lambda: None)),
        run,
        lambda _scene_id: None,
        slots=slots,
        starts_at_once=1,
        poll_s=poll_s,
        has_room=lambda: True,
    )
    dispatcher.start()
    try:
        yield dispatcher
    finally:
        dispatcher.stop()


@pytest.mark.parametrize(
    "error", [OperationalError("SELECT", {}, Exception("the server restarts")), ValueError("a defect")]
)
def test_a_worker_goes_on_taking_jobs_after_an_error(error: Exception) -> None:
    ran = threading.Event()
    with _dispatching(BrokenQueue(error), ran, poll_s=0.01):
        assert ran.wait(_WITHIN_S)


def test_a_worker_that_is_woken_takes_a_job_without_waiting() -> None:
    queue, ran = LaterQueue(), threading.Event()
    with _dispatching(queue, ran, poll_s=3600) as dispatcher:
        assert queue.asked.wait(_WITHIN_S)
        queue.job = Turn("job", "scene", JobKind.UPDATE, 1, "worker-0")
        dispatcher.wake()
        assert ran.wait(_WITHIN_S)


def test_a_lost_notification_only_delays_a_job() -> None:
    queue, ran = LaterQueue(), threading.Event()
    with _dispatching(queue, ran, poll_s=0.01):
        assert queue.asked.wait(_WITHIN_S)
        queue.job = Turn("job", "scene", JobKind.UPDATE, 1, "worker-0")
        assert ran.wait(_WITHIN_S)


def test_a_job_that_ends_makes_room_for_the_next_at_once() -> None:
    jobs = [Turn(f"job-{number}", "scene", JobKind.UPDATE, 1, "worker-0") for number in range(3)]
    ran, last = [], threading.Event()

    def run(turn: Turn) -> None:
        ran.append(turn)
        if len(ran) == len(jobs):
            last.set()

    left = iter(jobs)
    queue = SimpleNamespace(
        taken_by=lambda _worker: (), take=lambda _worker: next(left, None), put_back=lambda *_: None
    )
    with _dispatching(queue, run, poll_s=3600):
        assert last.wait(_WITHIN_S)
    assert ran == jobs


def test_a_turn_that_is_taken_while_the_last_one_ends_is_run() -> None:
    waker: list[Dispatcher] = []
    turns: list[Turn] = []
    twice = threading.Event()

    def run(turn: Turn) -> None:
        turns.append(turn)
        if len(turns) == 2:
            twice.set()

    queue = QuickQueue(lambda: waker[0].wake())
    with _dispatching(queue, run, poll_s=3600, slots=2) as dispatcher:
        waker.append(dispatcher)
        assert twice.wait(_WITHIN_S)
    assert len(turns) == 2
