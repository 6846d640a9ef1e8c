"""The queue in the database, with two workers, and what waiting jobs say."""

import threading
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest
from fvs_service.host.worker.heartbeat import Heartbeats
from fvs_service.jobs.fleet import workers_of
from fvs_service.jobs.queue import JobQueue, take_job
from fvs_service.storage.notifications import Topic
from fvs_service.storage.tables import JobRow, WorkerRow
from sqlalchemy import update

from fvs_schema.jobs import WaitReason


@pytest.fixture
def gateway(open_gateway: Any) -> Any:
    """A gateway of one's own: all its jobs are in one line."""
    return open_gateway(limits={"running_jobs_per_tenant": 2}, require_keys=True)


def _queue(gateway: Any) -> JobQueue:
    return gateway.application.storage.queue


def _jobs(gateway: Any, tenant: str, count: int) -> list[str]:
    headers = gateway.key(tenant)
    return [gateway.queue(gateway.scene(headers), headers=headers) for _ in range(count)]


def _waiting(gateway: Any, tenant: str, job_id: str) -> Any:
    return gateway.client.get(f"/v1/jobs/{job_id}", headers=gateway.key(tenant)).json()["waiting"]


def test_jobs_are_taken_once_in_the_fair_order(gateway: Any) -> None:
    a, b = _jobs(gateway, "a", 3), _jobs(gateway, "b", 1)
    queue = _queue(gateway)
    taken = [queue.take(f"worker-{number}") for number in range(4)]
    assert [turn.job_id for turn in taken if turn] == [a[0], b[0], a[1]]  # a has no more than two
    assert queue.taken_by("worker-1") == (taken[1],)
    queue.put_back(replace(taken[0], worker_id="worker-1"))  # not its own
    assert queue.take("worker-1") is None
    queue.put_back(taken[0])
    next_one = queue.take("worker-1")
    assert next_one is not None
    assert next_one.job_id == a[2]  # its scene has not been served yet


def test_a_worker_that_comes_too_late_looks_again_at_once(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (job_id,) = _jobs(gateway, "a", 1)
    late = iter([True])

    def take(*arguments: Any) -> Any:
        return None if next(late, False) else take_job(*arguments)

    monkeypatch.setattr("fvs_service.jobs.queue.take_job", take)
    taken = _queue(gateway).take("worker-0")
    assert taken is not None
    assert taken.job_id == job_id


def test_what_lets_a_job_have_its_turn_wakes_the_workers(gateway: Any) -> None:
    woken = threading.Event()
    subscription = gateway.application.storage.database.subscribe({Topic.JOBS: woken.set})

    def wakes(change: Callable[[], object]) -> bool:
        woken.clear()
        change()
        return woken.wait(30)

    headers = gateway.key("a")
    scene, queue = gateway.scene(headers), _queue(gateway)
    assert wakes(lambda: gateway.queue(scene, headers=headers))
    turn = queue.take("worker-0")
    assert turn is not None
    assert wakes(lambda: queue.put_back(turn))
    assert queue.take("worker-0") == turn
    assert wakes(lambda: queue.keep_workers(()))
    path = f"/v1/jobs/{turn.job_id}"
    assert wakes(lambda: gateway.client.post(f"{path}:cancel", headers=headers))
    assert wakes(lambda: gateway.client.post(f"{path}:retry", headers=headers))
    subscription.close()


def test_workers_that_look_at_once_never_get_the_same_job(gateway: Any) -> None:
    wanted = {*_jobs(gateway, "a", 2), *_jobs(gateway, "b", 2), *_jobs(gateway, "c", 2)}
    queue, found, ready = _queue(gateway), [], threading.Barrier(4)

    def work(worker_id: str) -> None:
        ready.wait()
        for _ in range(6):
            turn = queue.take(worker_id)
            if turn is not None:
                found.append(turn.job_id)

    threads = [threading.Thread(target=work, args=(f"worker-{number}",)) for number in range(4)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert sorted(found) == sorted(wanted)


def test_the_jobs_of_workers_that_no_longer_exist_wait_again(gateway: Any) -> None:
    (job,), (other,) = _jobs(gateway, "a", 1), _jobs(gateway, "b", 1)
    queue, database = _queue(gateway), gateway.application.storage.database
    for number in range(3):
        Heartbeats(database, f"worker-{number}").beat()
    turn, kept = queue.take("worker-1"), queue.take("worker-0")
    assert turn is not None
    assert kept is not None
    assert (turn.job_id, kept.job_id) == (job, other)
    assert queue.keep_workers(["worker-0", "worker-3"]) == 1
    with database.reading() as session:
        assert [worker.id for worker in workers_of(session)] == ["worker-0"]
    assert queue.taken_by("worker-0") == (kept,)
    assert not queue.has(turn)
    again = queue.take("worker-0")
    assert again == replace(turn, worker_id="worker-0")
    assert queue.has(again)
    assert queue.keep_workers(["worker-0"]) == 0


def test_a_job_that_lacks_something_is_not_taken_at_once_again(gateway: Any) -> None:
    (job,) = _jobs(gateway, "a", 1)
    queue = _queue(gateway)
    Heartbeats(gateway.application.storage.database, "worker-0").beat(slots=1)
    turn = queue.take("worker-0")
    assert turn is not None
    assert _waiting(gateway, "a", job) is None
    queue.put_back(turn, WaitReason.DISK)
    assert queue.take("worker-0") is None
    waiting = _waiting(gateway, "a", job)
    assert (waiting["place"], waiting["reason"]) == (1, "disk")
    with gateway.application.storage.database.writing() as session:
        session.execute(update(JobRow).values(not_before_ms=1))  # later
    assert queue.take("worker-0") == turn


def test_waiting_jobs_say_their_place_and_reason(gateway: Any) -> None:
    a, b = _jobs(gateway, "a", 3), _jobs(gateway, "b", 1)
    assert _waiting(gateway, "b", b[0])["reason"] == "no-worker"
    heartbeats = Heartbeats(gateway.application.storage.database, "worker-0")
    heartbeats.beat(slots=1)
    places = [_waiting(gateway, "a", job)["place"] for job in a] + [_waiting(gateway, "b", b[0])["place"]]
    assert sorted(places) == [1, 2, 3, 4]
    assert _waiting(gateway, "a", a[2])["reason"] == "tenant-limit"
    behind = _waiting(gateway, "b", b[0])
    assert (behind["place"], behind["reason"]) == (2, "queue")
    assert behind["message"] == "1 job goes first."
    heartbeats.beat(slots=1, disk_full=True)
    assert _waiting(gateway, "b", b[0])["reason"] == "disk"
    with gateway.application.storage.database.writing() as session:
        session.execute(update(WorkerRow).values(beaten_at_ms=1))  # silent
    assert _waiting(gateway, "b", b[0])["reason"] == "no-worker"


@pytest.mark.system
def test_a_job_that_pauses_says_so_and_is_canceled_at_once(gateway: Any) -> None:
    headers = gateway.key("a")
    scene = gateway.scene(headers)
    job = gateway.queue(scene, headers=headers)
    queue, storage = _queue(gateway), gateway.application.storage
    turn = queue.take("worker-0")
    assert turn is not None
    lease = gateway.lease(scene, "worker-0")
    storage.ledger.start(lease, job, 1)
    storage.ledger.report(lease, job, "training", 0.5)
    queue.put_back(turn)
    paused = gateway.client.get(f"/v1/jobs/{job}", headers=headers).json()
    assert (paused["state"], paused["progress"], paused["waiting"]["place"]) == ("running", 0.5, 1)
    canceled = gateway.client.post(f"/v1/jobs/{job}:cancel", headers=headers).json()
    assert (canceled["state"], canceled["waiting"]) == ("canceled", None)
    assert queue.take("worker-0") is None


def test_a_waiting_job_estimates_when_it_has_its_turn(gateway: Any) -> None:
    headers = gateway.key("a")
    heartbeats = Heartbeats(gateway.application.storage.database, "worker-0")
    heartbeats.beat(slots=1)
    first, second = _jobs(gateway, "a", 2)
    assert _waiting(gateway, "a", second)["eta_s"] is None  # nothing has ended yet
    gateway.model(gateway.scene(headers), headers)
    assert 0 <= _waiting(gateway, "a", first)["eta_s"] <= _waiting(gateway, "a", second)["eta_s"] < 60
