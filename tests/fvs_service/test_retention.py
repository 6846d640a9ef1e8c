"""Snapshots and rankings that are no longer kept."""

import time
from datetime import timedelta
from typing import Any

import pytest
from fvs_service.deletion.retention import RetentionRules
from fvs_service.model import now
from fvs_service.settings import Retention
from fvs_service.storage.tables import SnapshotRow
from sqlalchemy import update


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
    return [item["id"] for item in gateway.client.get(f"/v1/scenes/{scene}/snapshots").json()["items"]]


def test_retention_by_number_keeps_the_newest_and_the_pinned(open_gateway: Any) -> None:
    gateway = open_gateway()
    own, usual = gateway.scene(retention={"snapshots": 1, "rankings": 2}), gateway.scene()
    made = {scene: [gateway.model(scene) for _ in range(4)] for scene in (own, usual)}
    rankings = [_rank(gateway, own) for _ in range(4)]
    gateway.client.patch(f"/v1/snapshots/{made[own][1]}", json={"pinned": True})
    assert _apply(gateway, snapshots=3) == 2 + 2 + 1
    assert _snapshots(gateway, own) == [made[own][1], made[own][3]]
    assert _snapshots(gateway, usual) == made[usual][1:]
    found = [gateway.client.get(f"/v1/rankings/{ranking}").status_code for ranking in rankings]
    assert found == [404, 404, 200, 200]
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


def test_all_rankings_beyond_a_limit_are_deleted_in_one_sweep(
    open_gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fvs_service.deletion.retention._RANKINGS_AT_ONCE", 2)
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
    with database.writing() as session:
        session.execute(
            update(SnapshotRow).where(SnapshotRow.id != made[2]).values(created_at=now() - timedelta(hours=1))
        )
    RetentionRules(database, Retention(snapshots=1), grace_s=180).apply()
    assert _snapshots(gateway, scene) == made[1:]
