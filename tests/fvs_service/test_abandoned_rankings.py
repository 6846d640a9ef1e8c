"""Rankings that nobody waits for, from the client's connection to the runner's queue."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import httpx2
import pytest
from fvs_service.rankings.port import RankedViews, RankViews
from fvs_service.worker.runner import server
from fvs_service.worker.runner.model_states import ModelStates
from fvs_service.worker.runners import LeasedRunners

from fvs_engine.candidates import CandidateStatus, RankedCandidate
from fvs_engine.monitor import Monitor

_VIEW_S = 0.01


@dataclass
class Scoring:
    """Stands for the engine: every view takes 0.01 s, and ``began`` has the seed of each ranking.

    A ranking ends only while ``may_end`` is set.
    """

    began: list[int] = field(default_factory=list)
    ended: list[int] = field(default_factory=list)
    busy: threading.Event = field(default_factory=threading.Event)
    may_end: threading.Event = field(default_factory=threading.Event)

    def __post_init__(self) -> None:
        self.may_end.set()

    def __call__(self, request: RankViews, _state: Any, _rasterizer: Any, monitor: Monitor) -> RankedViews:
        self.began.append(request.seed)
        self.busy.set()
        for done in range(len(request.views)):
            monitor.check()
            time.sleep(_VIEW_S)
            monitor.report("score", done + 1, len(request.views))
        while not self.may_end.wait(_VIEW_S):
            monitor.check()
        self.ended.append(request.seed)
        candidates = [
            RankedCandidate(number, view.name, 0.0, CandidateStatus.RANKED, 1.0, None)
            for number, view in enumerate(request.views, start=1)
        ]
        return RankedViews(
            snapshot_id=request.snapshot_id, iterations=7, gaussians=60, candidates=tuple(candidates)
        )


@dataclass
class Scene:
    """A scene with a runner whose scoring is slow."""

    scoring: Scoring
    gateway: Any
    path: str

    def ask(self, views: int, seed: int = 0, timeout_s: float = 60.0, **headers: str) -> httpx2.Response:
        with httpx2.Client(base_url=self.gateway.client.base_url, timeout=timeout_s) as client:
            document = {"generator": {"kind": "orbit", "count": views}, "seed": seed}
            return client.post(self.path, json=document, headers=headers)

    def abandon(self, views: int, seed: int, after_s: float) -> None:
        with pytest.raises(httpx2.TimeoutException):
            self.ask(views, seed, after_s)


@pytest.fixture
def scene(serve: Callable[..., Any], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Scene]:
    scoring = Scoring()
    monkeypatch.setattr(server, "rank_views", scoring)
    monkeypatch.setattr(ModelStates, "newest", lambda *_: None)
    gateway = serve(runners=LeasedRunners, worker={"backend": "reference"})
    scene_id = gateway.scene()
    gateway.model(scene_id)
    runner = server.RunnerServer(scene_id, tmp_path, gateway.settings, "secret")
    threading.Thread(target=runner.serve, daemon=True).start()
    host, port = runner.address
    gateway.application.storage.leases.extend(gateway.lease(scene_id), f"{host}:{port}/secret")
    yield Scene(scoring, gateway, f"/v1/scenes/{scene_id}/rankings")
    runner._socket.close()


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


def test_a_scene_is_usable_at_once_after_many_clients_hung_up(scene: Scene) -> None:
    clients, views = 12, 600  # 72 s of scoring
    together([lambda seed=seed: scene.abandon(views, seed, after_s=2.0) for seed in range(1, clients + 1)])
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


def test_renders_are_asked_for_in_the_same_way(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    began = threading.Semaphore(0)

    def render(_request: Any, _state: Any, _rasterizer: Any) -> bytes:
        began.release()
        time.sleep(0.5)
        return b"png"

    monkeypatch.setattr(server, "render_view", render)
    monkeypatch.setattr(ModelStates, "of_snapshot", lambda *_: None)
    ranking = scene.ask(5).json()
    path = f"/v1/rankings/{ranking['id']}/candidates/orbit-0000/render.png"
    answers = together([lambda: scene.gateway.client.get(path).content] * 4)
    assert answers == [b"png"] * 4
    assert began.acquire(blocking=False)
    assert not began.acquire(blocking=False)
