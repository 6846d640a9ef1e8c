"""Jobs that pause for others and for a full disk, with the real dispatcher and a runner that only reports."""

import itertools
import socket
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from typing import Any

import pytest
from fvs_service.host.protocol.connection import Connection, RunnerGoneError
from fvs_service.host.protocol.messages import StageProgress
from fvs_service.host.worker import outcomes, resources, stop, turns
from fvs_service.host.worker.dispatcher import Dispatcher
from fvs_service.host.worker.heartbeat import Heartbeats
from fvs_service.host.worker.resources import Room
from fvs_service.host.worker.runners import RunnerRequests
from fvs_service.host.worker.turns import MAX_STARTS
from fvs_service.jobs import ledger, order, queue
from fvs_service.settings import WorkerSettings
from fvs_service.storage.tables import JobRow
from granted_scenes import GrantedScenes
from sqlalchemy import update

from fvs_schema.stages import Stage

_WORKER = "worker-0"
_PATIENCE_S = 60.0


class CountingRunner:
    """Counts to 8 for every job, keeps the count when it is stopped, and then says that the job is over.

    A job ends as failed, which needs no snapshot. Jobs in ``endless`` go on counting.
    """

    def __init__(self) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        host, port = self._socket.getsockname()
        self.endpoint = f"{host}:{port}/secret"
        self.counts: Counter[str] = Counter()
        self.starts: list[str] = []
        self.endless: set[str] = set()
        self._stop = threading.Event()
        threading.Thread(target=self._accept, daemon=True).start()

    def close(self) -> None:
        self._socket.close()

    def _accept(self) -> None:
        with suppress(OSError):
            while True:
                connection = Connection(self._socket.accept()[0])
                threading.Thread(target=self._serve, args=(connection,), daemon=True).start()

    def _serve(self, connection: Connection) -> None:
        with closing(connection), suppress(RunnerGoneError):
            connection.receive()
            request = connection.receive()
            if request["kind"] == "cancel":
                self._stop.set()
                connection.send({"result": None})
                return
            job = request["job_id"]
            self.starts.append(job)
            self._stop.clear()
            code = "training-failed"
            while self.counts[job] < 8 or job in self.endless:
                self.counts[job] += 1
                share = 1 - 0.9 ** self.counts[job]
                connection.send({"part": StageProgress(stage=Stage.TRAINING, share=share)})
                if self._stop.wait(0.02):
                    code = "cancelled"
                    break
            connection.send({"error": {"code": code, "message": "Over.", "hint": "", "retryable": True}})


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "_PAUSE_S", 0.0)
    monkeypatch.setattr(outcomes, "_PAUSE_S", 0.0)
    monkeypatch.setattr(ledger, "_REPORT_EVERY_S", 0.0)
    monkeypatch.setattr(order, "_SETTLED_MS", 0)
    monkeypatch.setattr(stop, "_LOOK_EVERY_S", 0.0)
    monkeypatch.setattr(resources, "START_BYTES", 1_000)
    monkeypatch.setattr(resources, "_LOOK_EVERY_S", -1.0)
    # A job that lacks something says so until it may try again: see `_let_all_try_again`.
    monkeypatch.setattr(queue, "_TRY_AGAIN_MS", 1_000_000)


@pytest.fixture
def gateway(open_gateway: Any) -> Any:
    worker = WorkerSettings(turn_s=0.1)
    return open_gateway(require_keys=True, worker=worker, reserve_bytes=1_000_000)


@pytest.fixture
def runner() -> Iterator[CountingRunner]:
    made = CountingRunner()
    yield made
    made.close()


@pytest.fixture
def worker(gateway: Any, runner: CountingRunner) -> Iterator[Callable[[], None]]:
    """Start a worker with one slot."""
    storage = gateway.application.storage
    room = Room(storage.settings)
    scenes = GrantedScenes(gateway, runner.endpoint, _WORKER)
    dispatcher = Dispatcher(
        _WORKER,
        storage.queue,
        RunnerRequests(storage.database),
        scenes.turns(room).run,
        lambda _scene: None,
        slots=1,
        starts_at_once=1,
        poll_s=0.02,
        has_room=lambda: not room.short,
    )
    Heartbeats(storage.database, _WORKER).beat()
    yield dispatcher.start
    runner.endless.clear()
    dispatcher.stop()


class Tenant:
    """A tenant with its jobs."""

    def __init__(self, gateway: Any, name: str) -> None:
        self._gateway, self._headers = gateway, gateway.key(name)

    def queue(self) -> str:
        return self._gateway.queue(self._gateway.scene(self._headers), headers=self._headers)

    def job(self, job_id: str) -> dict[str, Any]:
        return self._gateway.client.get(f"/v1/jobs/{job_id}", headers=self._headers).json()

    def wait(self, job_id: str, until: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        deadline = time.monotonic() + _PATIENCE_S
        while not until(found := self.job(job_id)):
            assert time.monotonic() < deadline, found
            time.sleep(0.02)
        return found


def _ended(job: dict[str, Any]) -> bool:
    return job["state"] == "failed"


def _waits_for(reason: str) -> Callable[[dict[str, Any]], bool]:
    return lambda job: job["waiting"] is not None and job["waiting"]["reason"] == reason


def _let_all_try_again(gateway: Any) -> None:
    with gateway.application.storage.database.writing() as session:
        session.execute(update(JobRow).values(not_before_ms=0))


def test_a_long_job_makes_room_for_another_tenant_and_goes_on_where_it_was(
    gateway: Any, runner: CountingRunner, worker: Callable[[], None]
) -> None:
    a, b = Tenant(gateway, "a"), Tenant(gateway, "b")
    long = a.queue()
    runner.endless.add(long)
    worker()
    a.wait(long, lambda job: job["state"] == "running")
    small = b.queue()
    b.wait(small, _ended)
    assert runner.starts[:2] == [long, small]
    paused = a.job(long)
    assert (paused["state"], paused["attempt"]) == ("running", 1)
    before = runner.counts[long]
    runner.endless.clear()
    ended = a.wait(long, _ended)
    assert ended["error"]["code"] == "training-failed"  # not that of a pause
    assert runner.counts[long] >= before > 1
    assert runner.starts.count(long) >= 2


def test_two_endless_tenants_both_come_farther(
    gateway: Any, runner: CountingRunner, worker: Callable[[], None]
) -> None:
    a, b = Tenant(gateway, "a"), Tenant(gateway, "b")
    jobs = [a.queue(), b.queue()]
    runner.endless.update(jobs)
    worker()
    deadline = time.monotonic() + _PATIENCE_S
    while min(runner.starts.count(job) for job in jobs) < 3:
        assert time.monotonic() < deadline
        time.sleep(0.05)
    assert runner.starts[:4] == [*jobs, *jobs]


def test_jobs_wait_for_a_full_disk_and_go_on_by_themselves(
    gateway: Any, runner: CountingRunner, worker: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    free, looks = {"bytes": 2_000_000}, itertools.count()

    def free_bytes(_folder: Any) -> int:
        next(looks)
        return free["bytes"]

    monkeypatch.setattr(resources, "free_bytes", free_bytes)
    a = Tenant(gateway, "a")
    job = a.queue()
    runner.endless.add(job)
    worker()
    a.wait(job, lambda found: found["progress"] > 0)
    free["bytes"] = 900_000
    paused = a.wait(job, _waits_for("disk"))
    assert (paused["state"], paused["error"]) == ("running", None)
    next_one = a.queue()
    free["bytes"] = 1_000_500  # the reserve, and too little to start
    enough, deadline = next(looks) + 5, time.monotonic() + _PATIENCE_S
    while next(looks) < enough:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    assert runner.starts == [job]
    assert a.job(next_one)["state"] == "queued"
    runner.endless.clear()
    free["bytes"] = 2_000_000
    _let_all_try_again(gateway)
    a.wait(job, _ended)
    a.wait(next_one, _ended)


def test_a_job_that_meets_a_full_disk_again_and_again_fails(
    gateway: Any, runner: CountingRunner, worker: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each time there is room once the job waits for it, and none when the job has started."""
    starts_with_room = 0

    def free_bytes(_folder: Any) -> int:
        return 2_000_000 if len(runner.starts) == starts_with_room else 900_000

    def ended(found: dict[str, Any]) -> bool:
        nonlocal starts_with_room
        if _waits_for("disk")(found):
            starts_with_room = len(runner.starts)
            _let_all_try_again(gateway)
        return _ended(found)

    monkeypatch.setattr(resources, "free_bytes", free_bytes)
    monkeypatch.setattr(CountingRunner, "_serve", _serve_on_a_full_disk)
    a = Tenant(gateway, "a")
    job = a.queue()
    worker()
    failed = a.wait(job, ended)
    assert (failed["error"]["code"], failed["error"]["retryable"]) == ("out-of-space", True)
    assert "/" not in failed["error"]["message"] + failed["error"]["hint"]
    assert len(runner.starts) == MAX_STARTS


def _serve_on_a_full_disk(runner: CountingRunner, connection: Connection) -> None:
    with closing(connection), suppress(RunnerGoneError):
        connection.receive()
        connection.receive()
        runner.starts.append("job")
        path = "/srv/fvs/scenes/scn_1/checkpoint"
        error = {"code": "disk-full", "message": f"There is no room left to write {path}.", "hint": ""}
        connection.send({"error": {**error, "retryable": True}})
