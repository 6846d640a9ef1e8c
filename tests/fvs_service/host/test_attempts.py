"""Attempts whose processes die, with a fake runner."""

import itertools
import json
import socket
import threading
from collections.abc import Iterator
from typing import Any

import pytest
from fvs_service.host.protocol.connection import Connection
from fvs_service.host.protocol.messages import StageProgress
from fvs_service.host.worker import outcomes, turns
from fvs_service.host.worker.starts import Starts
from fvs_service.host.worker.turns import MAX_STARTS
from fvs_service.jobs import ledger
from granted_scenes import GrantedScenes

from fvs_schema.stages import Stage


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
            connection.send({"part": StageProgress(stage=Stage.TRAINING, share=next(self._shares))})
            if self._of_its_child:
                death = {"code": "process-died", "message": "Stage 'match' was killed.", "hint": ""}
                connection.send({"error": {**death, "retryable": True}})
            connection.close()


@pytest.fixture(autouse=True)
def _at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(turns, "_PAUSE_S", 0.0)
    monkeypatch.setattr(outcomes, "_PAUSE_S", 0.0)
    monkeypatch.setattr(ledger, "_REPORT_EVERY_S", 0.0)


def _run(gateway: Any, scenes: GrantedScenes) -> Any:
    """The job once it has been run to its end."""
    job = gateway.queue(gateway.scene())
    turn = gateway.take(job)
    scenes.turns().run(turn)
    return gateway.client.get(f"/v1/jobs/{job}").json()


@pytest.mark.parametrize("of_its_child", [True, False])
def test_a_job_that_kills_its_processes_at_the_same_point_fails(gateway: Any, of_its_child: bool) -> None:
    runner = DyingRunner(itertools.repeat(0.5), of_its_child=of_its_child)
    scenes = GrantedScenes(gateway, runner.endpoint)
    found = _run(gateway, scenes)
    runner.close()
    assert runner.asked == MAX_STARTS
    # A runner whose child died is well: it stays warm, and answers rankings.
    assert scenes.dropped == (0 if of_its_child else MAX_STARTS)
    assert (found["state"], found["error"]["code"]) == ("failed", "runner-died")
    assert ("Stage 'match' was killed." in found["error"]["message"]) == of_its_child
    assert found["error"]["retryable"]
    assert found["error"]["hint"]


def test_lines_about_a_job_name_it_its_scene_and_the_worker(
    gateway: Any, capsys: pytest.CaptureFixture[str]
) -> None:
    runner = DyingRunner(itertools.repeat(0.5), of_its_child=True)
    found = _run(gateway, GrantedScenes(gateway, runner.endpoint))
    runner.close()
    lines = [json.loads(line) for line in capsys.readouterr().err.splitlines() if line.startswith("{")]
    about = {"job": found["id"], "scene": found["scene_id"]}
    for event in ("job started", "starting again", "job ended"):
        (line, *_) = [line for line in lines if line["event"] == event]
        assert line.items() >= about.items()
        assert line["worker"]


def test_a_job_that_comes_farther_each_time_is_not_given_up(gateway: Any) -> None:
    shares = itertools.chain([0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8], itertools.repeat(0.8))
    runner = DyingRunner(shares, of_its_child=True)
    found = _run(gateway, GrantedScenes(gateway, runner.endpoint))
    runner.close()
    assert runner.asked == 8 + MAX_STARTS - 1
    assert found["state"] == "failed"


def test_a_runner_that_does_not_start_is_given_up(gateway: Any) -> None:
    scenes = GrantedScenes(gateway, None)
    found = _run(gateway, scenes)
    assert scenes.started == MAX_STARTS
    assert found["error"]["message"].endswith("The runner did not start.")


def test_a_job_that_is_canceled_after_its_worker_died_needs_no_runner(gateway: Any) -> None:
    job = gateway.queue(scene := gateway.scene())
    storage = gateway.application.storage
    dead = gateway.lease(scene, "dead")
    storage.ledger.start(dead, job, 1)
    gateway.client.post(f"/v1/jobs/{job}:cancel")
    storage.leases.release(dead)
    scenes = GrantedScenes(gateway, None)
    storage.queue.keep_workers(())
    scenes.turns().run(gateway.take(job))
    assert scenes.started == 0
    assert gateway.client.get(f"/v1/jobs/{job}").json()["state"] == "canceled"


def test_starts_of_processes_that_died_count(gateway: Any) -> None:
    job = gateway.queue(gateway.scene())
    turn = gateway.take(job)
    storage = gateway.application.storage
    for _ in range(MAX_STARTS):  # each started, and its process died, wherever it was
        Starts(storage.database, turn).begin(0.0)
    scenes = GrantedScenes(gateway, None)
    scenes.turns().run(turn)
    assert scenes.started == 0
    found = gateway.client.get(f"/v1/jobs/{job}").json()
    assert found["error"]["message"].endswith("its process died")
