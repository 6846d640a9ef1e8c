from types import SimpleNamespace
from typing import Any

import pytest
from fvs_service.worker import host as host_module
from fvs_service.worker.host import Host


def test_a_scene_that_another_worker_holds_is_not_warmed_here(gateway: Any) -> None:
    """Its runner may only be starting: taking the scene from it would start another one, all over."""
    scene = gateway.scene()
    theirs = gateway.lease(scene, "theirs")
    host = Host(gateway.application.storage, "ours")
    try:
        host.warm(scene)  # returns at once
    finally:
        host.stop()
    assert gateway.application.storage.leases.holder(scene) == theirs


def test_a_scene_keeps_its_memory_until_the_last_one_is_done_with_it(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A ranking has the scene warmed while a job works in it."""

    class Child(SimpleNamespace):
        def __init__(self, *_: Any) -> None:
            super().__init__(alive=True, endpoint="127.0.0.1:9/secret")

        def extend(self) -> None: ...

        def idle_s(self) -> float:
            return 0.0

        def kill(self) -> None: ...

        def retire(self, _patience_s: float) -> None: ...

    monkeypatch.setattr(host_module, "RunnerChild", Child)
    monkeypatch.setattr(host_module, "memory_limit_bytes", lambda _: 4_000_000_000)
    learning, another = gateway.scene(), gateway.scene()
    host = Host(gateway.application.storage, "ours")
    try:
        with host.hold(learning, 3_500_000_000, lambda: False):
            host.warm(learning)
            with host.hold(another, 1_000_000_000, lambda: True) as refused:
                assert refused is None
        with host.hold(another, 1_000_000_000, lambda: True) as hosted:
            assert hosted is not None
    finally:
        host.stop()
