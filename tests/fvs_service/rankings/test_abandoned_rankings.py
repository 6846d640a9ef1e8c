"""Rankings that nobody waits for, from the client's connection to the runner's queue."""

import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from fvs_service.host.runner import server
from fvs_service.host.runner.snapshot_models import SnapshotModels
from slow_scoring import Scene, slow_scene

POSE = {"frame": "model", "position": [0.0, 0.0, -4.0], "orientation_wxyz": [1.0, 0.0, 0.0, 0.0]}


@pytest.fixture
def scene(serve: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    with slow_scene(serve, tmp_path, monkeypatch) as scene:
        yield scene


def together(calls: list[Callable[[], Any]]) -> list[Any]:
    results: list[Any] = [None] * len(calls)

    def call(number: int) -> None:
        results[number] = calls[number]()

    threads = [threading.Thread(target=call, args=(number,)) for number in range(len(calls))]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    return results


@pytest.mark.system
def test_a_scene_is_usable_at_once_after_many_clients_hung_up(scene: Scene) -> None:
    clients, views = 12, 200  # 24 s of scoring
    together([lambda seed=seed: scene.abandon(views, seed, after_s=1.0) for seed in range(1, clients + 1)])
    began = time.monotonic()
    answer = scene.ask(5)
    assert answer.status_code == 201, answer.text
    assert time.monotonic() - began < 10
    assert scene.scoring.ended == [0]
    assert len(scene.scoring.began) < clients  # most were never begun


def test_the_same_question_over_many_connections_is_computed_once(scene: Scene) -> None:
    answers = together([lambda: scene.ask(100)] * 6)
    assert {answer.status_code for answer in answers} == {201}
    assert scene.scoring.began == [0]
    assert len({answer.json()["id"] for answer in answers}) == 6


def test_who_asks_again_after_a_timeout_does_not_ask_for_more_work(scene: Scene) -> None:
    scene.scoring.may_end.clear()
    patient = threading.Thread(target=scene.ask, args=(20,))
    patient.start()
    assert scene.scoring.busy.wait(60)
    for _ in range(4):
        scene.abandon(20, 0, after_s=0.3)
    scene.scoring.may_end.set()
    patient.join()
    assert scene.scoring.began == [0]


def test_nothing_is_computed_for_longer_than_the_client_says(scene: Scene) -> None:
    answer = scene.ask(2000, **{"X-Timeout-S": "0.5"})
    assert (answer.status_code, answer.json()["code"]) == (504, "deadline-exceeded")
    assert scene.ask(5, seed=1).status_code == 201
    assert scene.scoring.ended == [1]


@pytest.mark.parametrize("of", ["candidate", "pose"])
def test_renders_are_asked_for_in_the_same_way(
    of: str, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    began = threading.Semaphore(0)

    def render(_request: Any, _state: Any, _rasterizer: Any) -> bytes:
        began.release()
        time.sleep(0.5)
        return b"png"

    monkeypatch.setattr(server, "render_view", render)
    monkeypatch.setattr(SnapshotModels, "of_snapshot", lambda *_: None)
    ranking = scene.ask(5).json()
    if of == "candidate":
        asked = ("GET", f"/v1/rankings/{ranking['id']}/candidates/orbit-0000/render.png", None)
    else:
        asked = ("POST", f"/v1/snapshots/{ranking['snapshot_id']}/renders", {"pose": POSE})
    client = scene.gateway.client
    answers = together([lambda: client.request(*asked[:2], json=asked[2]).content] * 4)
    assert answers == [b"png"] * 4
    assert began.acquire(blocking=False)
    assert not began.acquire(blocking=False)
