"""Ended jobs and idempotency keys that are no longer kept."""

import time
from datetime import timedelta
from typing import Any

import pytest
from fvs_service.deletion.idempotency_retention import IdempotencyRetention
from fvs_service.deletion.job_retention import JobRetention
from fvs_service.settings import Retention
from fvs_service.storage.clock import now
from fvs_service.storage.tables import IdempotencyRow, JobMilestoneRow, JobRow
from sqlalchemy import func, select, update


def _jobs(gateway: Any, jobs: int | None = None, job_days: float | None = None) -> JobRetention:
    return JobRetention(gateway.application.storage.database, Retention(jobs=jobs, job_days=job_days))


def _keys(gateway: Any, most: int = 1_000, days: float = 2.0) -> IdempotencyRetention:
    keep = Retention(idempotency_keys=most, idempotency_days=days)
    return IdempotencyRetention(gateway.application.storage.database, keep)


def _canceled(gateway: Any, scene: str, count: int) -> list[str]:
    """The ids of so many jobs that were queued and canceled."""
    made = []
    for _ in range(count):
        made.append(gateway.queue(scene))
        assert gateway.client.post(f"/v1/jobs/{made[-1]}:cancel").status_code in (200, 202)
    return made


def _kept(gateway: Any, scene: str) -> list[str]:
    with gateway.application.storage.database.reading() as session:
        return list(session.scalars(select(JobRow.id).where(JobRow.scene_id == scene).order_by(JobRow.id)))


def _all_are_old(gateway: Any, table: Any, days: float) -> None:
    with gateway.application.storage.database.writing() as session:
        session.execute(update(table).values(created_at=now() - timedelta(days=days)))


def test_a_scene_keeps_its_newest_jobs_and_those_with_a_snapshot(open_gateway: Any) -> None:
    gateway = open_gateway()
    many, few = gateway.scene(), gateway.scene()
    gateway.model(many)
    (with_snapshot,) = _kept(gateway, many)
    ended, others = _canceled(gateway, many, 5), _canceled(gateway, few, 2)
    queued = gateway.queue(many)
    retention = _jobs(gateway, jobs=3)
    assert retention.apply() == 3
    assert retention.apply() == 0
    assert _kept(gateway, many) == [with_snapshot, *ended[3:], queued]
    assert _kept(gateway, few) == others
    assert gateway.client.get(f"/v1/jobs/{ended[0]}").status_code == 404
    assert gateway.client.get(f"/v1/jobs/{with_snapshot}").status_code == 200
    _canceled(gateway, few, 2)
    assert retention.apply() == 1


def test_the_newest_job_of_a_machine_whose_clock_is_right_stays(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway()
    scene = gateway.scene()
    right = time.time_ns
    retention = _jobs(gateway, jobs=2)
    with monkeypatch.context() as patch:
        patch.setattr("fvs_service.ids.time.time_ns", lambda: right() + 600 * 10**9)
        ahead = _canceled(gateway, scene, 2)
    assert retention.apply() == 0
    last = _canceled(gateway, scene, 1)
    assert retention.apply() == 1
    assert set(_kept(gateway, scene)) == {ahead[1], *last}


def test_old_jobs_go_unless_they_have_not_ended(open_gateway: Any) -> None:
    gateway = open_gateway()
    scene = gateway.scene()
    gateway.model(scene)
    (with_snapshot,) = _kept(gateway, scene)
    _canceled(gateway, scene, 2)
    queued = gateway.queue(scene)
    _all_are_old(gateway, JobRow, 9)
    assert _jobs(gateway, job_days=10).apply() == 0
    assert _jobs(gateway).apply() == 0
    assert _jobs(gateway, job_days=8).apply() == 2
    assert _kept(gateway, scene) == [with_snapshot, queued]
    snapshot = gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
    gateway.model(scene)  # another snapshot is the current one
    _all_are_old(gateway, JobRow, 9)
    assert gateway.client.delete(f"/v1/snapshots/{snapshot}").status_code == 204
    assert _jobs(gateway, job_days=8).apply() == 1
    assert with_snapshot not in _kept(gateway, scene)
    with gateway.application.storage.database.reading() as session:
        milestones = session.scalars(select(JobMilestoneRow.job_id).distinct()).all()
    assert with_snapshot not in milestones


def test_a_tenant_keeps_its_newest_idempotency_keys(open_gateway: Any) -> None:
    gateway = open_gateway()

    def create(key: str) -> str:
        made = gateway.client.post("/v1/scenes", json={"name": "a"}, headers={"Idempotency-Key": key})
        assert made.status_code in (200, 201), made.text
        return str(made.json()["id"])

    made = {key: create(key) for key in ("first", "second", "third", "fourth")}
    retention = _keys(gateway, most=2)
    assert retention.apply() == 2
    assert retention.apply() == 0
    assert create("fourth") == made["fourth"]
    assert create("first") != made["first"]
    assert retention.apply() == 1
    assert create("third") != made["third"]


def test_old_idempotency_keys_are_forgotten(open_gateway: Any) -> None:
    gateway = open_gateway()
    gateway.client.post("/v1/scenes", json={"name": "a"}, headers={"Idempotency-Key": "a"})
    _all_are_old(gateway, IdempotencyRow, 3)
    assert _keys(gateway, days=4).apply() == 0
    assert _keys(gateway, days=2).apply() == 1
    with gateway.application.storage.database.reading() as session:
        assert session.scalar(select(func.count()).select_from(IdempotencyRow)) == 0
