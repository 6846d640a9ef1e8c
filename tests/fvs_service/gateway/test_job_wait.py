"""Requests that wait for a job: `wait_s`."""

import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

import pytest


@pytest.fixture
def ask(gateway: Any) -> Any:
    return _asking(gateway)


def _asking(gateway: Any) -> Callable[..., "Future[Any]"]:
    """Ask for a job in a thread, and return once the request waits."""
    pool, feed = ThreadPoolExecutor(4), gateway.app.state.feed

    def start(job: str, wait_s: float = 30.0) -> "Future[Any]":
        waiting = feed._followers
        asked = pool.submit(gateway.client.get, f"/v1/jobs/{job}", params={"wait_s": wait_s})
        deadline = time.monotonic() + 20
        while feed._followers == waiting:
            assert time.monotonic() < deadline
            time.sleep(0.005)
        return asked

    return start


def test_a_change_of_the_state_is_answered_at_once_and_progress_is_not(gateway: Any, ask: Any) -> None:
    scene = gateway.scene()
    job, ledger, lease = gateway.queue(scene), gateway.application.storage.ledger, gateway.lease(scene)
    started = ask(job)
    ledger.start(lease, job, 1)
    assert started.result().json()["state"] == "running"
    ended, other = ask(job), gateway.queue(gateway.scene())
    ledger.report(lease, job, "training", 0.5, eta_s=3.0)
    gateway.client.post(f"/v1/jobs/{other}:cancel")
    ledger.succeed(lease, job)
    assert ended.result().json()["state"] == "succeeded"


def test_a_job_that_has_ended_is_answered_at_once(gateway: Any) -> None:
    job = gateway.queue(gateway.scene())
    gateway.client.post(f"/v1/jobs/{job}:cancel")
    began = time.monotonic()
    assert gateway.client.get(f"/v1/jobs/{job}", params={"wait_s": 30}).json()["state"] == "canceled"
    assert time.monotonic() - began < 20


def test_without_a_change_the_job_is_answered_in_the_end(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_service.gateway.job_wait.LONGEST_S", 0.4)
    job = gateway.queue(gateway.scene())
    for wait_s in (0.2, 86_400):
        began = time.monotonic()
        answer = gateway.client.get(f"/v1/jobs/{job}", params={"wait_s": wait_s})
        assert answer.json()["state"] == "queued"
        assert min(wait_s, 0.4) <= time.monotonic() - began < 20


@pytest.mark.parametrize("wait_s", ["-1", "nan", "inf", "86401", "long"])
def test_a_time_without_sense_is_refused(gateway: Any, wait_s: str) -> None:
    job = gateway.queue(gateway.scene())
    answer = gateway.client.get(f"/v1/jobs/{job}", params={"wait_s": wait_s})
    assert answer.status_code == 422
    assert answer.json()["errors"][0]["field"] == "wait_s"


def test_who_waits_for_a_job_that_is_deleted_learns_it(gateway: Any, ask: Any) -> None:
    scene = gateway.scene()
    waiting = ask(gateway.queue(scene))
    gateway.client.delete(f"/v1/scenes/{scene}")
    assert waiting.result().status_code == 404


def test_waiting_ends_when_the_gateway_stops(open_gateway: Any) -> None:
    gateway = open_gateway()
    waiting = _asking(gateway)(gateway.queue(gateway.scene()))
    gateway.client.portal.call(gateway.app.state.feed.close)
    answer = waiting.result()
    assert (answer.status_code, answer.json()["state"]) == (200, "queued")


def test_as_many_wait_as_may_follow_events(open_gateway: Any) -> None:
    gateway = open_gateway(limits={"event_streams_per_tenant": 1})
    job = gateway.queue(gateway.scene())
    waiting = _asking(gateway)(job)
    refused = gateway.client.get(f"/v1/jobs/{job}", params={"wait_s": 30})
    assert (refused.status_code, refused.json()["code"]) == (429, "limit-exceeded")
    assert gateway.client.get(f"/v1/jobs/{job}").status_code == 200
    gateway.client.post(f"/v1/jobs/{job}:cancel")
    assert waiting.result().json()["state"] == "canceled"
