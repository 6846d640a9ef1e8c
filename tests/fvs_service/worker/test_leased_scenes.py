from types import SimpleNamespace
from typing import Any

import pytest
from fvs_service.worker import leased_scenes
from fvs_service.worker.leased_scenes import LeasedScenes


def test_no_runner_is_started_for_a_scene_that_another_worker_has_leased(gateway: Any) -> None:
    """Its runner may only be starting: taking the scene from it would start another one, all over."""
    scene = gateway.scene()
    theirs = gateway.lease(scene, "theirs")
    scenes = LeasedScenes(gateway.application.storage, "ours")
    try:
        scenes.start_runner(scene)  # returns at once
    finally:
        scenes.stop()
    assert gateway.application.storage.leases.holder(scene) == theirs


def test_a_scene_keeps_its_memory_until_the_last_one_is_done_with_it(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ranking has the scene warmed while a job works in it."""

    class Child(SimpleNamespace):
        def __init__(self, *_: Any) -> None:
            super().__init__(alive=True, endpoint="127.0.0.1:9/secret", backend="cpu")

        def extend(self) -> None: ...

        def idle_s(self) -> float:
            return 0.0

        def kill(self) -> None: ...

        def retire(self, _patience_s: float) -> None: ...

    monkeypatch.setattr(leased_scenes, "RunnerChild", Child)
    monkeypatch.setattr(leased_scenes, "memory_limit_bytes", lambda _: 4_000_000_000)
    training, another = gateway.scene(), gateway.scene()
    scenes = LeasedScenes(gateway.application.storage, "ours")
    assert scenes.backend == "auto"
    try:
        with scenes.with_runner(training, 3_500_000_000, lambda: False):
            assert scenes.backend == "cpu"  # what the runner says
            scenes.start_runner(training)
            with scenes.with_runner(another, 1_000_000_000, lambda: True) as refused:
                assert refused is None
        with scenes.with_runner(another, 1_000_000_000, lambda: True) as leased:
            assert leased is not None
    finally:
        scenes.stop()
