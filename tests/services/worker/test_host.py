from typing import Any

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
