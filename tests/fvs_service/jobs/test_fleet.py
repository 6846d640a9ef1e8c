"""Workers, jobs and the queue as operators see them."""

import threading
import time
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from fvs_service.errors import StorageUnavailableError
from fvs_service.host.worker.heartbeat import Heartbeats
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from fvs_service.storage.store_check import StoreCheck
from fvs_service.storage.tables import WorkerRow


@pytest.fixture
def fleet(open_gateway: Any) -> Any:
    """A gateway with a worker that lives and one that fell silent 30 s ago."""
    gateway = open_gateway()
    database = gateway.application.storage.database
    Heartbeats(database, "worker-0").beat(backend="cpu", runner_bytes=7_000)
    Heartbeats(database, "worker-1").beat()
    with database.writing() as session:
        row = session.get(WorkerRow, "worker-1")
        assert row is not None
        row.beaten_at_ms -= 30_000
    return gateway


def test_readiness_tells_the_gateway_from_the_fleet(fleet: Any) -> None:
    assert fleet.client.get("/readyz").status_code == 200
    assert fleet.client.get("/readyz?workers=1").status_code == 200
    answer = fleet.client.get("/readyz?workers=2")
    assert (answer.status_code, answer.json()["code"]) == (503, "unavailable")
    assert answer.json()["detail"].startswith(
        "1 of 2 required workers are alive. No heartbeat from worker-1 for 3"
    )


def test_a_service_without_workers_is_ready_for_uploads_only(gateway: Any) -> None:
    assert gateway.client.get("/readyz").status_code == 200
    assert gateway.client.get("/readyz?workers=1").status_code == 503


def test_a_gateway_without_its_blob_store_is_not_ready(gateway: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    blobs, asked = gateway.application.storage.blobs, []

    def gone() -> None:
        asked.append(1)
        raise StorageUnavailableError("The object store has no such bucket.", hint="Create it.")

    fresh = StoreCheck(blobs)
    monkeypatch.setattr(gateway.application.store_check, "_current", fresh._current)
    assert gateway.client.get("/readyz").status_code == 200
    monkeypatch.setattr(blobs, "check", gone)
    assert gateway.client.get("/readyz").status_code == 200  # the store was asked a moment ago
    monkeypatch.setattr("fvs_service.storage.store_check._FRESH_S", 0.0)
    answer = gateway.client.get("/readyz")
    assert (answer.status_code, answer.json()["detail"]) == (503, "The object store has no such bucket.")
    monkeypatch.setattr("fvs_service.storage.store_check._FRESH_S", 60.0)
    assert "fvs_blobs_up 0.0" in gateway.client.get("/metrics").text
    assert gateway.client.get("/readyz").status_code == 503
    assert len(asked) == 1


def test_a_blob_store_that_hangs_is_waited_for_once(tmp_path: Path) -> None:
    blobs, hanging, asked = Blobs(tmp_path / "blobs"), threading.Event(), []
    check, took_s = StoreCheck(blobs, within_s=1.0), []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(blobs, "check", lambda: asked.append(1) or hanging.wait(30))
        for _ in range(3):
            started = time.monotonic()
            with pytest.raises(StorageUnavailableError, match="not answered"):
                check.require()
            took_s.append(time.monotonic() - started)
        hanging.set()
        check._current()[0].result(10)
        check.require()
    assert len(asked) == 1
    assert took_s[0] > 0.5 > max(took_s[1:])


def test_a_folder_of_blobs_that_is_gone_is_no_store(tmp_path: Path) -> None:
    blobs = Blobs(tmp_path / "blobs")
    StoreCheck(blobs).require()
    (tmp_path / "blobs").rmdir()
    with pytest.raises(StorageUnavailableError, match="is gone"):
        StoreCheck(blobs).require()


def test_capabilities_name_the_workers(fleet: Any) -> None:
    found = fleet.client.get("/v1/capabilities").json()
    assert [(worker["id"], worker["alive"]) for worker in found["workers"]] == [
        ("worker-0", True),
        ("worker-1", False),
    ]
    assert found["workers"][0]["backend"] == "cpu"
    assert found["job_kinds"] == ["update", "fine", "frames"]


def test_metrics_show_workers_queue_and_room(fleet: Any) -> None:
    scene = fleet.scene()
    fleet.queue(scene)
    time.sleep(0.01)
    lines = dict(
        line.rsplit(" ", 1) for line in fleet.client.get("/metrics").text.splitlines() if line[0] != "#"
    )
    assert float(lines['fvs_worker_alive{worker="worker-0"}']) == 1
    assert float(lines['fvs_worker_alive{worker="worker-1"}']) == 0
    assert float(lines['fvs_worker_heartbeat_age_seconds{worker="worker-1"}']) >= 30
    assert float(lines['fvs_runner_bytes{worker="worker-0"}']) == 7_000
    assert float(lines['fvs_jobs{kind="update",stage="",state="queued"}']) == 1
    assert float(lines["fvs_queue_length"]) == 1
    assert float(lines["fvs_queue_oldest_seconds"]) > 0
    assert float(lines["fvs_disk_free_bytes"]) > 0
    assert float(lines["fvs_database_up"]) == 1


def test_the_wait_of_a_job_does_not_depend_on_the_clocks_of_machines(
    fleet: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as patch:
        patch.setattr("fvs_service.jobs.service.now", lambda: now() - timedelta(minutes=10))
        fleet.queue(fleet.scene())
    lines = fleet.client.get("/metrics").text.splitlines()
    (waited,) = (line.split()[1] for line in lines if line.startswith("fvs_queue_oldest_seconds"))
    assert float(waited) < 60


def test_the_lag_of_the_event_loop_is_measured(gateway: Any) -> None:
    deadline = time.monotonic() + 20
    while "fvs_loop_lag_seconds_count 0.0" in gateway.client.get("/metrics").text:
        assert time.monotonic() < deadline
    assert "fvs_loop_lag_seconds_count" in gateway.client.get("/metrics").text
