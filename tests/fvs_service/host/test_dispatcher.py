"""The dispatcher's loop, with queues that fail, and that have a job later."""

import threading
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


@contextmanager
def _dispatching(
    queue: object, ran: threading.Event | Callable[[Turn], None], poll_s: float
) -> Iterator[Dispatcher]:
    run = (lambda _ticket: ran.set()) if isinstance(ran, threading.Event) else ran
    dispatcher = Dispatcher(
        "worker-0",
        cast(JobQueue, queue),
        cast(RunnerRequests, SimpleNamespace(take=lambda: None)),
        run,
        lambda _scene_id: None,
        slots=1,
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
