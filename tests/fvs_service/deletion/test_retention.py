"""Snapshots and rankings that are no longer kept."""

import time
from datetime import timedelta
from typing import Any

import pytest
from fvs_service.deletion.retention import RetentionRules
from fvs_service.jobs.timing import TIMING, JobSize, JobTiming, past_timings
from fvs_service.jobs.waiting import _usual_s
from fvs_service.settings import Retention
from fvs_service.snapshots.repository import with_artifacts
from fvs_service.storage.clock import now
from fvs_service.storage.tables import JobMilestoneRow, JobRow, SnapshotArtifactRow, SnapshotRow
from sqlalchemy import select, update

from fvs_schema.jobs import JobKind


def _rank(gateway: Any, scene: str) -> str:
    """The id of a new ranking."""
    asked = {"generator": {"kind": "orbit", "count": 8}}
    made = gateway.client.post(f"/v1/scenes/{scene}/rankings", json=asked)
    assert made.status_code == 201, made.text
    return str(made.json()["id"])


def _apply(gateway: Any, **usual: Any) -> int:
    database = gateway.application.storage.database
    return RetentionRules(database, Retention(**usual), grace_s=0).apply()


def _snapshots(gateway: Any, scene: str) -> list[str]:
    listed = gateway.client.get(f"/v1/scenes/{scene}/snapshots").json()["items"]
    return [item["id"] for item in reversed(listed)]


def test_retention_by_number_keeps_the_newest_and_the_pinned(open_gateway: Any) -> None:
    gateway = open_gateway()
    own, usual = gateway.scene(retention={"snapshots": 1, "rankings": 2, "plans": 1}), gateway.scene()
    made = {scene: [gateway.model(scene) for _ in range(4)] for scene in (own, usual)}
    rankings = [_rank(gateway, own) for _ in range(4)]
    plans = [gateway.client.post(f"/v1/scenes/{own}/plans", json={}).json()["id"] for _ in range(4)]
    gateway.client.patch(f"/v1/snapshots/{made[own][1]}", json={"pinned": True})
    assert _apply(gateway, snapshots=3) == 2 + 2 + 3 + 1
    assert _snapshots(gateway, own) == [made[own][1], made[own][3]]
    assert _snapshots(gateway, usual) == made[usual][1:]
    found = [gateway.client.get(f"/v1/rankings/{ranking}").status_code for ranking in rankings]
    assert found == [404, 404, 200, 200]
    found = [gateway.client.get(f"/v1/plans/{plan}").status_code for plan in plans]
    assert found == [404, 404, 404, 200]
    assert _apply(gateway, snapshots=3) == 0
    assert gateway.client.get(f"/v1/scenes/{own}").json()["snapshot_id"] == made[own][3]


def test_retention_by_number_does_not_depend_on_the_clocks_of_machines(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway()
    scene = gateway.scene()
    right = time.time_ns
    with monkeypatch.context() as patch:
        patch.setattr("fvs_service.ids.time.time_ns", lambda: right() + 600 * 10**9)
        made = [gateway.model(scene) for _ in range(3)]
        rankings = [_rank(gateway, scene) for _ in range(3)]
    made.append(gateway.model(scene))
    rankings.append(_rank(gateway, scene))
    assert (min(made), min(rankings)) == (made[3], rankings[3])
    assert _apply(gateway, snapshots=2, rankings=3) == 3
    assert set(_snapshots(gateway, scene)) == {*made[2:]}
    found = [gateway.client.get(f"/v1/rankings/{ranking}").status_code for ranking in rankings]
    assert found == [404, 200, 200, 200]


def test_the_latest_is_found_whatever_the_clocks_of_machines_say(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    gateway = open_gateway()
    scene = gateway.scene()
    right = time.time_ns
    with monkeypatch.context() as patch:
        patch.setattr("fvs_service.ids.time.time_ns", lambda: right() + 600 * 10**9)
        gateway.model(scene)
    newest = gateway.model(scene)
    with gateway.application.storage.database.writing(scene) as session:
        first, last = session.scalars(select(JobRow).order_by(*JobRow.oldest_first())).all()
        assert first.id > last.id
        for job, took_s in ((first, 1000), (last, 10)):
            job.finished_at = job.started_at + timedelta(seconds=took_s)
            size = JobSize(first=True, images=6, new=6, megapixels=1, train_megapixels=1, iterations=7)
            timing = JobTiming(size=size, seconds={"training": took_s}).model_dump(mode="json")
            session.add(JobMilestoneRow(job_id=job.id, name=TIMING, document=timing, created_at=now()))
        session.execute(update(SnapshotArtifactRow).values(sha256="0" * 64))  # equal models
    monkeypatch.setattr("fvs_service.jobs.waiting._RECENT", 1)
    monkeypatch.setattr("fvs_service.jobs.timing._RECENT", 1)
    with gateway.application.storage.database.reading() as session:
        assert _usual_s(session, JobKind.UPDATE) == 10
        (timing,) = past_timings(session, JobKind.UPDATE, first=True)
        assert timing.seconds == {"training": 10}
        found = with_artifacts(session, scene, {"point_cloud.ply": "0" * 64})
    assert found is not None
    assert found.id == newest


@pytest.mark.parametrize("ahead", [timedelta(minutes=10), timedelta(minutes=-10)])
def test_what_was_the_newest_a_moment_ago_stays_whatever_a_clock_says(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch, ahead: timedelta
) -> None:
    gateway = open_gateway()
    scene = gateway.scene()
    made = [gateway.model(scene) for _ in range(3)]
    rules = RetentionRules(gateway.application.storage.database, Retention(snapshots=1), grace_s=60)
    monkeypatch.setattr("fvs_service.deletion.retention.now", lambda: now() + ahead)
    assert rules.apply() == 0
    database = gateway.application.storage.database
    with database.writing(scene) as session:  # the newest two took their places two minutes ago
        session.execute(
            update(SnapshotRow)
            .where(SnapshotRow.scene_id == scene)
            .values(recorded_at_ms=SnapshotRow.recorded_at_ms - 120_000)
        )
    assert rules.apply() == 2
    assert _snapshots(gateway, scene) == made[2:]


def test_all_rankings_beyond_a_limit_are_deleted_in_one_sweep(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_service.deletion.retention._RESULTS_AT_ONCE", 2)
    gateway = open_gateway()
    scene = gateway.scene(retention={"rankings": 1})
    gateway.model(scene)
    rankings = [_rank(gateway, scene) for _ in range(6)]
    _apply(gateway)
    found = [gateway.client.get(f"/v1/rankings/{ranking}").status_code for ranking in rankings]
    assert found == [404] * 5 + [200]


def test_retention_by_age_never_takes_the_current_snapshot(open_gateway: Any) -> None:
    gateway = open_gateway()
    scene = gateway.scene()
    made = [gateway.model(scene) for _ in range(3)]
    assert _apply(gateway) == 0
    with gateway.application.storage.database.writing() as session:
        session.execute(update(SnapshotRow).values(created_at=now() - timedelta(days=9)))
    assert _apply(gateway, snapshot_days=10) == 0
    assert _apply(gateway, snapshot_days=8) == 2
    assert _snapshots(gateway, scene) == made[2:]


def test_retention_spares_a_snapshot_that_was_the_newest_a_moment_ago(open_gateway: Any) -> None:
    gateway = open_gateway()
    scene = gateway.scene()
    made = [gateway.model(scene) for _ in range(3)]
    database = gateway.application.storage.database
    older = update(SnapshotRow).where(SnapshotRow.id != made[2])
    with database.writing() as session:
        session.execute(older.values(recorded_at_ms=SnapshotRow.recorded_at_ms - 3_600_000))
    RetentionRules(database, Retention(snapshots=1), grace_s=180).apply()
    assert _snapshots(gateway, scene) == made[1:]
