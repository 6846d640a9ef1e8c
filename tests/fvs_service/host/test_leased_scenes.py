import socket
import threading
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from fvs_service.errors import StorageUnavailableError
from fvs_service.host.protocol.connection import RunnerGoneError, call
from fvs_service.host.protocol.messages import Ping, RunnerOrder
from fvs_service.host.worker import leased_scenes, runner_child
from fvs_service.host.worker.leased_scenes import LeasedScenes
from fvs_service.host.worker.runner_child import RunnerChild
from fvs_service.settings import Settings


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


@pytest.mark.parametrize("where", ["acquire", "extend"])
def test_a_scene_that_cannot_be_leased_keeps_neither_memory_nor_a_runner(
    gateway: Any, monkeypatch: pytest.MonkeyPatch, where: str
) -> None:
    """As when the database is away for a moment: other scenes would wait for that memory."""
    killed = []

    class Child(SimpleNamespace):
        def __init__(self, scene_id: str, *_: Any) -> None:
            super().__init__(scene_id=scene_id, alive=True, endpoint="127.0.0.1:9/secret", backend="cpu")

        def extend(self) -> None: ...

        def idle_s(self) -> float:
            return 0.0

        def kill(self) -> None:
            killed.append(self.scene_id)

        def retire(self, _patience_s: float) -> None: ...

    def unavailable(*_: Any) -> None:
        raise StorageUnavailableError("The database cannot be reached.")

    monkeypatch.setattr(leased_scenes, "RunnerChild", Child)
    monkeypatch.setattr(leased_scenes, "memory_limit_bytes", lambda _: 4_000_000_000)
    failing, another = gateway.scene(), gateway.scene()
    storage = gateway.application.storage
    scenes = LeasedScenes(storage, "ours")
    try:
        with monkeypatch.context() as away:
            away.setattr(type(storage.leases), where, unavailable)
            with (
                pytest.raises(StorageUnavailableError),
                scenes.with_runner(failing, 3_500_000_000, lambda: False),
            ):
                pass
        assert killed == ([failing] if where == "extend" else [])
        with scenes.with_runner(another, 1_000_000_000, lambda: True) as leased:
            assert leased is not None
    finally:
        scenes.stop()


def test_a_runner_that_answers_no_ping_is_killed_while_a_job_uses_it(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(runner_child, "_RESPONSE_S", 0.05)
    killed = threading.Event()
    with socket.create_server(("127.0.0.1", 0)) as deaf:  # connections succeed, nobody accepts them

        class Child(RunnerChild):
            def __init__(self, scene_id: str, *_: Any) -> None:
                self.scene_id, self.backend = scene_id, "cpu"
                self.endpoint = f"127.0.0.1:{deaf.getsockname()[1]}/secret"

            alive = property(lambda _: not killed.is_set())

            def extend(self) -> None: ...

            def kill(self) -> None:
                killed.set()

        monkeypatch.setattr(leased_scenes, "RunnerChild", Child)
        gateway = open_gateway(lease_s=1)
        scenes = LeasedScenes(gateway.application.storage, "ours")
        try:
            with scenes.with_runner(gateway.scene(), 1, lambda: False):
                assert killed.wait(60)
        finally:
            scenes.stop()


def test_asking_how_long_a_runner_has_been_idle_does_not_use_up_its_patience(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A host on a cluster asks each second; three unanswered pings end a runner, one for each lease."""

    class Child(SimpleNamespace):
        def __init__(self, *_: Any) -> None:
            super().__init__(alive=True, endpoint="127.0.0.1:9/secret", backend="cpu")

        def extend(self) -> None: ...

        def idle_s(self) -> None:
            return None

        def kill(self) -> None: ...

        def retire(self, _patience_s: float) -> None: ...

    monkeypatch.setattr(leased_scenes, "RunnerChild", Child)
    scenes = LeasedScenes(gateway.application.storage, "ours")
    try:
        with scenes.with_runner(gateway.scene(), 1, lambda: False) as leased:
            assert leased is not None
            assert [scenes.idle_s() for _ in range(10)] == [0.0] * 10
            assert leased.unanswered <= 1
    finally:
        scenes.stop()


@pytest.mark.system
@pytest.mark.process
def test_a_runner_listens_where_its_worker_says(gateway: Any) -> None:
    scenes = LeasedScenes(gateway.application.storage, "ours", "127.0.0.2")
    try:
        with scenes.with_runner(gateway.scene(), 1, lambda: False) as leased:
            assert leased is not None
            assert leased.endpoint.startswith("127.0.0.2:")
            call(leased.endpoint, Ping(), 30)
            with pytest.raises(RunnerGoneError):
                call(leased.endpoint.replace("127.0.0.2", "127.0.0.1"), Ping(), 30)
    finally:
        scenes.stop()


def test_a_large_log_is_put_aside_when_the_runner_starts(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(runner_child, "_LOG_BYTES", 10)
    monkeypatch.setattr(runner_child.child_process, "spawn", lambda *_, stderr, **__: stderr.write("new"))
    order = RunnerOrder(scene_id="scn", parent=1, settings=Settings(root=tmp_path))
    log = tmp_path / "runner.log"
    for content in ("short ", "a long one "):
        log.write_text(content)
        runner_child._spawn(log, order)
    assert log.read_text() == "new"
    assert (tmp_path / "runner.old.log").read_text() == "a long one "
