import threading
import time

from fvs_service.host.worker.resources import (
    MemoryBudget,
    idle_need_bytes,
    job_need_bytes,
    memory_limit_bytes,
)
from fvs_service.settings import WorkerSettings

from fvs_schema.jobs import JobKind, JobRequest


def _never() -> bool:
    return False


def test_what_does_not_fit_waits_until_something_is_released() -> None:
    budget = MemoryBudget(100, make_room=_never)
    assert budget.reserve("a", 60, _never)
    admitted = threading.Event()

    def reserve() -> None:
        assert budget.reserve("b", 50, _never)
        admitted.set()

    thread = threading.Thread(target=reserve)
    thread.start()
    assert not admitted.wait(0.2)
    budget.shrink("a", 50)
    assert admitted.wait(5)
    thread.join()


def test_a_scene_that_needs_more_than_all_runs_alone() -> None:
    budget = MemoryBudget(100, make_room=_never)
    assert budget.reserve("a", 10, _never)
    until = time.monotonic() + 0.1
    assert not budget.reserve("huge", 1000, lambda: time.monotonic() > until)
    budget.release("a")
    assert budget.reserve("huge", 1000, _never)


def test_what_is_not_used_makes_room() -> None:
    budget = MemoryBudget(100, make_room=lambda: budget.release("idle") is None)
    assert budget.reserve("idle", 80, _never)
    assert budget.reserve("busy", 80, lambda: True)


def test_a_scene_is_not_in_its_own_way() -> None:
    budget = MemoryBudget(100, make_room=_never)
    assert budget.reserve("a", 60, _never)
    assert budget.reserve("a", 90, lambda: True)


def test_a_question_does_not_take_from_a_scene_what_its_job_needs() -> None:
    budget = MemoryBudget(100, make_room=_never)
    assert budget.reserve("learning", 80, _never)
    assert budget.reserve("learning", 10, _never)
    assert not budget.reserve("another", 50, lambda: True)
    budget.shrink("learning", 10)
    assert budget.reserve("another", 50, lambda: True)


def test_a_fine_model_needs_more_than_an_update() -> None:
    settings = WorkerSettings()
    update = job_need_bytes(JobRequest(kind=JobKind.UPDATE), (), settings)
    fine = job_need_bytes(JobRequest(kind=JobKind.FINE), (), settings)
    assert idle_need_bytes(0) < update < fine


def test_workers_share_the_machine() -> None:
    one, two = (memory_limit_bytes(WorkerSettings(count=count)) for count in (1, 2))
    assert abs(one - 2 * two) <= 2
    assert memory_limit_bytes(WorkerSettings(memory_bytes=7)) == 7
