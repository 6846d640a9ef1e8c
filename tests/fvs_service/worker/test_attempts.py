"""Attempts whose processes die, with a fake runner and fake leased scenes."""

import itertools
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import pytest
from fvs_service.jobs import ledger
from fvs_service.worker import attempts
from fvs_service.worker.attempts import MAX_TRIES, Attempts
from fvs_service.worker.leased_scenes import LeasedScene, LeasedScenes
from fvs_service.worker.protocol.connection import Connection, RunnerGoneError
from fvs_service.worker.room import Room
from fvs_service.worker.tries import Tries


class DyingRunner:
    """Reports progress, and then that its SfM child died, or nothing more, as if it had died itself."""

    def __init__(self, shares: Iterator[float], *, of_its_child: bool) -> None:
        self._shares, self._of_its_child = shares, of_its_child
        self._socket = socket.create_server(("127.0.0.1", 0))
        host, port = self._socket.getsockname()
        self.endpoint = f"{host}:{port}/secret"
        self.asked = 0
        self._thread = threading.Thread(target=self._serve)
        self._thread.start()

    def close(self) -> None:
        self._socket.shutdown(socket.SHUT_RDWR)
        self._thread.join()
        self._socket.close()

    def _serve(self) -> None:
        while True:
            try:
                connection = Connection(self._socket.accept()[0])
            except OSError:
                return
            connection.receive()
            assert connection.receive()["kind"] == "job"
            self.asked += 1
            connection.send({"progress": {"stage": "train", "share": next(self._shares)}})
            if self._of_its_child:
                death = {"code": "process-died", "message": "Stage 'match' was killed.", "hint": ""}
                connection.send({"error": {**death, "retryable": True}})
            connection.close()


class FakeScenes:
    """Grants a lease for any scene, with the given runner; without one, no runner starts."""

    stopping = False

    def __init__(self, gateway: Any, runner: DyingRunner | None) -> None:
        self._gateway, self._runner = gateway, runner
        self.started = self.dropped = 0

    @contextmanager
    def with_runner(self, scene_id: str, *_: Any) -> Iterator[LeasedScene]:
        self.started += 1
        if self._runner is None:
            raise RunnerGoneError("The runner did not start.")
        child: Any = SimpleNamespace(endpoint=self._runner.endpoint)
        yield LeasedScene(self._gateway.lease(scene_id), child)

    @contextmanager
    def without_runner(self, scene_id: str, _give_up: Any) -> Iterator[Any]:
        yield self._gateway.lease(scene_id)

    def drop(self, _scene: LeasedScene) -> None:
        self.dropped += 1


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attempts, "_PAUSE_S", 0.0)
    monkeypatch.setattr(ledger, "_REPORT_EVERY_S", 0.0)


def _attempts(gateway: Any, scenes: FakeScenes) -> Attempts:
    storage = gateway.application.storage
    return Attempts(storage, cast(LeasedScenes, scenes), "tester", Room(storage.settings))


def _run(gateway: Any, scenes: FakeScenes) -> Any:
    """The job once it has been run to its end."""
    job = gateway.queue(gateway.scene())
    ticket = gateway.take(job)
    _attempts(gateway, scenes).run(ticket)
    return gateway.client.get(f"/v1/jobs/{job}").json()


@pytest.mark.parametrize("of_its_child", [True, False])
def test_a_job_that_kills_its_processes_at_the_same_point_fails(gateway: Any, of_its_child: bool) -> None:
    runner = DyingRunner(itertools.repeat(0.5), of_its_child=of_its_child)
    scenes = FakeScenes(gateway, runner)
    found = _run(gateway, scenes)
    runner.close()
    assert runner.asked == MAX_TRIES
    # A runner whose child died is well: it stays warm, and answers rankings.
    assert scenes.dropped == (0 if of_its_child else MAX_TRIES)
    assert (found["state"], found["error"]["code"]) == ("failed", "runner-died")
    assert ("Stage 'match' was killed." in found["error"]["message"]) == of_its_child
    assert found["error"]["retryable"]
    assert found["error"]["hint"]


def test_a_job_that_comes_farther_each_time_is_not_given_up(gateway: Any) -> None:
    shares = itertools.chain([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8], itertools.repeat(0.8))
    runner = DyingRunner(shares, of_its_child=True)
    found = _run(gateway, FakeScenes(gateway, runner))
    runner.close()
    assert runner.asked == 8 + MAX_TRIES - 1
    assert found["state"] == "failed"


def test_a_runner_that_does_not_start_is_given_up(gateway: Any) -> None:
    scenes = FakeScenes(gateway, None)
    found = _run(gateway, scenes)
    assert scenes.started == MAX_TRIES
    assert found["error"]["message"].endswith("The runner did not start.")


def test_a_job_that_is_canceled_after_its_worker_died_needs_no_runner(gateway: Any) -> None:
    job = gateway.queue(scene := gateway.scene())
    storage = gateway.application.storage
    dead = gateway.lease(scene, "dead")
    storage.ledger.start(dead, job, 1)
    gateway.client.post(f"/v1/jobs/{job}:cancel")
    storage.leases.release(dead)
    scenes = FakeScenes(gateway, None)
    storage.queue.put_back_all("dead")
    _attempts(gateway, scenes).run(gateway.take(job))
    assert scenes.started == 0
    assert gateway.client.get(f"/v1/jobs/{job}").json()["state"] == "canceled"


def test_tries_of_workers_that_died_count(gateway: Any) -> None:
    job = gateway.queue(scene := gateway.scene())
    ticket = gateway.take(job)
    storage = gateway.application.storage
    for _ in range(MAX_TRIES):  # each started, and its worker died
        Tries(storage.settings.scenes / scene, ticket).start(0.0)
    scenes = FakeScenes(gateway, None)
    _attempts(gateway, scenes).run(ticket)
    assert scenes.started == 0
    found = gateway.client.get(f"/v1/jobs/{job}").json()
    assert found["error"]["message"].endswith("its worker died")
