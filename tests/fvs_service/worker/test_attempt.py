"""An attempt whose processes die: its host and its runner are played."""

import itertools
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any, cast

import pytest
from fvs_service.jobs import ledger
from fvs_service.worker import attempt
from fvs_service.worker.attempt import MAX_TRIES, Attempts
from fvs_service.worker.host import Host, Hosted
from fvs_service.worker.protocol import Line, RunnerGoneError
from fvs_service.worker.tries import Tries


class DyingRunner:
    """Tells how far it came, and then that its child has died; or nothing more, as if it had died itself."""

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
                line = Line(self._socket.accept()[0])
            except OSError:
                return
            line.receive()
            assert line.receive()["kind"] == "job"
            self.asked += 1
            line.send({"progress": {"stage": "train", "share": next(self._shares)}})
            if self._of_its_child:
                death = {"code": "process-died", "message": "Stage 'match' was killed.", "hint": ""}
                line.send({"error": {**death, "retryable": True}})
            line.close()


class PlayedHost:
    """Has the scene's lease, and the runner that it is given; without one none starts."""

    stopping = False

    def __init__(self, gateway: Any, runner: DyingRunner | None) -> None:
        self._gateway, self._runner = gateway, runner
        self.started = self.dropped = 0

    @contextmanager
    def hold(self, scene_id: str, *_: Any) -> Iterator[Hosted]:
        self.started += 1
        if self._runner is None:
            raise RunnerGoneError("The runner did not start.")
        child: Any = SimpleNamespace(endpoint=self._runner.endpoint)
        yield Hosted(self._gateway.lease(scene_id), child)

    @contextmanager
    def leased(self, scene_id: str, _give_up: Any) -> Iterator[Any]:
        yield self._gateway.lease(scene_id)

    def drop(self, _hosted: Hosted) -> None:
        self.dropped += 1


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(attempt, "_PAUSE_S", 0.0)
    monkeypatch.setattr(ledger, "_REPORT_EVERY_S", 0.0)


def _run(gateway: Any, host: PlayedHost) -> Any:
    """The job once it has been run to its end."""
    job = gateway.queue(gateway.scene())
    ticket = gateway.engine.submitted[f"{job}.1"]
    Attempts(gateway.application.storage, cast(Host, host)).run(ticket)
    return gateway.client.get(f"/v1/jobs/{job}").json()


@pytest.mark.parametrize("of_its_child", [True, False])
def test_a_job_that_kills_its_processes_at_the_same_point_fails(gateway: Any, of_its_child: bool) -> None:
    runner = DyingRunner(itertools.repeat(0.5), of_its_child=of_its_child)
    host = PlayedHost(gateway, runner)
    found = _run(gateway, host)
    runner.close()
    assert runner.asked == MAX_TRIES
    # A runner whose child died is well: it stays warm, and answers rankings.
    assert host.dropped == (0 if of_its_child else MAX_TRIES)
    assert (found["state"], found["error"]["code"]) == ("failed", "runner-died")
    assert ("Stage 'match' was killed." in found["error"]["message"]) == of_its_child
    assert found["error"]["retryable"]
    assert found["error"]["hint"]


def test_a_job_that_comes_farther_each_time_is_not_given_up(gateway: Any) -> None:
    shares = itertools.chain([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8], itertools.repeat(0.8))
    runner = DyingRunner(shares, of_its_child=True)
    found = _run(gateway, PlayedHost(gateway, runner))
    runner.close()
    assert runner.asked == 8 + MAX_TRIES - 1
    assert found["state"] == "failed"


def test_a_runner_that_does_not_start_is_given_up(gateway: Any) -> None:
    host = PlayedHost(gateway, None)
    found = _run(gateway, host)
    assert host.started == MAX_TRIES
    assert found["error"]["message"].endswith("The runner did not start.")


def test_a_job_that_is_canceled_after_its_worker_died_needs_no_runner(gateway: Any) -> None:
    job = gateway.queue(scene := gateway.scene())
    storage = gateway.application.storage
    dead = gateway.lease(scene)
    storage.ledger.start(dead, job, 1)
    gateway.client.post(f"/v1/jobs/{job}:cancel")
    host = PlayedHost(gateway, None)
    Attempts(storage, cast(Host, host)).run(gateway.engine.submitted[f"{job}.1"])
    assert host.started == 0
    assert gateway.client.get(f"/v1/jobs/{job}").json()["state"] == "canceled"


def test_tries_of_workers_that_died_count(gateway: Any) -> None:
    job = gateway.queue(scene := gateway.scene())
    ticket = gateway.engine.submitted[f"{job}.1"]
    storage = gateway.application.storage
    for _ in range(MAX_TRIES):  # each began, and was not heard of again
        Tries(storage.settings.scenes / scene, ticket).begin(0.0)
    host = PlayedHost(gateway, None)
    Attempts(storage, cast(Host, host)).run(ticket)
    assert host.started == 0
    found = gateway.client.get(f"/v1/jobs/{job}").json()
    assert found["error"]["message"].endswith("the death of its worker")
