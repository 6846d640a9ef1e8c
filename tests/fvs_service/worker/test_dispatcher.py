"""The dispatcher's loop, with a queue that fails."""

import threading
from types import SimpleNamespace
from typing import cast

import pytest
from fvs_service.jobs.model import JobKind
from fvs_service.jobs.queue import JobQueue
from fvs_service.jobs.ticket import JobTicket
from fvs_service.worker.dispatcher import Dispatcher
from fvs_service.worker.runner_requests import RunnerRequests
from sqlalchemy.exc import OperationalError


class BrokenQueue:
    """Fails when it is first asked for a job, then has one."""

    def __init__(self, error: Exception) -> None:
        self._answers = iter([error, JobTicket("job", "scene", JobKind.UPDATE, 1)])

    def taken_by(self, _worker_id: str) -> tuple[JobTicket, ...]:
        return ()

    def take(self, _worker_id: str) -> JobTicket | None:
        answer = next(self._answers, None)
        if isinstance(answer, Exception):
            raise answer
        return answer

    def put_back(self, *_: object) -> None:
        pass


@pytest.mark.parametrize(
    "error", [OperationalError("SELECT", {}, Exception("the server restarts")), ValueError("a defect")]
)
def test_a_worker_goes_on_taking_jobs_after_an_error(error: Exception) -> None:
    ran = threading.Event()
    dispatcher = Dispatcher(
        "worker-0",
        cast(JobQueue, BrokenQueue(error)),
        cast(RunnerRequests, SimpleNamespace(take=lambda: None)),
        lambda _ticket: ran.set(),
        lambda _scene_id: None,
        slots=1,
        poll_s=0.01,
        has_room=lambda: True,
    )
    dispatcher.start()
    try:
        assert ran.wait(30)
    finally:
        dispatcher.stop()
