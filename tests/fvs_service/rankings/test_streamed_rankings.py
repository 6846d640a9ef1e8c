"""Rankings that are streamed, from the runner's scoring to the client."""

import json
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fvs_service.host.protocol.connection import RunnerGoneError
from fvs_service.host.runner import server
from slow_scoring import ORBIT, Scene, slow_scene

SOON_S = 60.0


@pytest.fixture
def scene(serve: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    with slow_scene(serve, tmp_path, monkeypatch) as scene:
        yield scene


@contextmanager
def _stream(scene: Scene, views: int, **headers: str) -> Iterator[Iterator[httpx2.ServerSentEvent]]:
    asked = {"generator": {**ORBIT, "count": views}, "seed": 0}
    accept = {"Accept": "text/event-stream"}
    with (
        httpx2.Client(base_url=scene.gateway.client.base_url, timeout=SOON_S) as client,
        client.stream("POST", scene.path, json=asked, headers={**accept, **headers}) as response,
    ):
        if response.status_code != 200:
            response.read()
        assert response.status_code == 200, response.text
        yield iter(httpx2.EventSource(response))


def _parts(stream: Iterator[httpx2.ServerSentEvent]) -> list[dict[str, Any]]:
    return [json.loads(message.data) for message in stream]


def _until(true: Callable[[], bool]) -> None:
    until = time.monotonic() + SOON_S
    while not true():
        assert time.monotonic() < until
        time.sleep(0.01)


def test_candidates_arrive_as_they_are_scored(scene: Scene) -> None:
    scene.scoring.may_end.clear()
    with _stream(scene, 40) as stream:
        first = json.loads(next(stream).data)
        assert scene.scoring.ended == []  # it is scored still
        scene.scoring.may_end.set()
        parts = [first, *_parts(stream)]
    *scored, last = parts
    assert all(part["ranking"] is None and part["candidates"] for part in scored)
    assert last["candidates"] == []
    names = [one["id"] for part in scored for one in part["candidates"]]
    assert names == [f"orbit-{number:04d}" for number in range(40)]
    ranking = scene.gateway.client.get(f"/v1/rankings/{last['ranking']['id']}").json()
    assert last["ranking"] == ranking
    ranked = {one["id"]: one for one in ranking["candidates"]}
    for part in scored:
        for one in part["candidates"]:
            assert ranked[one["id"]].items() >= one.items()


def test_who_asks_the_same_later_gets_a_stream_of_its_own(scene: Scene) -> None:
    scene.scoring.may_end.clear()
    with _stream(scene, 30) as first, _stream(scene, 30) as second:
        streams = [[json.loads(next(one).data)] for one in (first, second)]
        plain = threading.Thread(target=scene.ask, args=(30,))
        plain.start()
        _until(lambda: len(scene.runner._requests._queue[0].requesters) == 3)
        scene.scoring.may_end.set()
        for parts, rest in zip(streams, (first, second), strict=True):
            parts += _parts(rest)
        plain.join()
    assert scene.scoring.began == [0]
    names = [[one["id"] for part in parts for one in part["candidates"]] for parts in streams]
    assert names[0] == names[1] == [f"orbit-{number:04d}" for number in range(30)]
    assert streams[0][-1]["ranking"]["id"] != streams[1][-1]["ranking"]["id"]


def test_scoring_stops_when_the_client_has_vanished(scene: Scene) -> None:
    with _stream(scene, 2000) as stream:
        next(stream)
    queue = scene.runner._requests
    _until(lambda: queue.status.computing == 0)
    assert scene.scoring.ended == []
    assert scene.ask(5).status_code == 201


@pytest.mark.system
def test_a_deadline_ends_a_stream_with_the_error_of_a_ranking(scene: Scene) -> None:
    scene.scoring.may_end.clear()
    with _stream(scene, 40, **{"X-Timeout-S": "4"}) as stream:
        *parts, last = stream
    assert all(message.event != "problem" for message in parts)
    assert last.event == "problem"
    problem = json.loads(last.data)
    assert (problem["status"], problem["code"]) == (504, "deadline-exceeded")
    assert problem["request_id"]
    assert problem["hint"]


def test_what_fails_before_the_first_candidate_is_a_plain_error(scene: Scene) -> None:
    scene.scoring.may_end.clear()
    refused = scene.ask(2001, Accept="text/event-stream")
    assert (refused.status_code, refused.json()["code"]) == (422, "invalid-request")


def test_when_the_connection_to_the_runner_breaks_scoring_begins_again(
    scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    send, sent = server._send_part, threading.Semaphore(0)

    def break_once(connection: Any, scores: Any) -> None:
        if sent.acquire(blocking=False):
            monkeypatch.setattr(server, "_send_part", send)
            raise RunnerGoneError
        send(connection, scores)
        sent.release()

    monkeypatch.setattr(server, "_send_part", break_once)
    with _stream(scene, 100) as stream:
        parts = _parts(stream)
    assert parts[-1]["ranking"] is not None
    names = [one["id"] for part in parts for one in part["candidates"]]
    assert len(names) > 100
    assert sorted(set(names)) == [f"orbit-{number:04d}" for number in range(100)]
    assert len(scene.scoring.began) == 2
