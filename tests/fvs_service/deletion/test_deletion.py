"""What is deleted is gone for every reader at once, and from the disk after the next sweep."""

import concurrent.futures
import threading
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from anyio.to_thread import run_sync
from fvs_service.errors import StaleLeaseError
from fvs_service.storage.clock import now
from fvs_service.storage.removals import Removals
from fvs_service.storage.tables import RemovalRow, Table
from sqlalchemy import func, select, update

QUESTION = {"generator": {"kind": "orbit", "count": 8}}


def _files(gateway: Any, scene: str) -> set[str]:
    folder = gateway.settings.root / "blobs" / "scenes" / scene
    return {str(file.relative_to(folder)) for file in folder.rglob("*") if file.is_file()}


def _remove(gateway: Any, later: bool = True) -> None:
    """Remove blobs as a sweep does, at once or after the grace period."""
    storage = gateway.application.storage
    storage.removals.run()
    if later:
        with storage.database.writing() as session:
            past = now() - timedelta(days=1)
            session.execute(
                update(RemovalRow).where(RemovalRow.removed_at.is_(None)).values(due_at=past, created_at=past)
            )
        storage.removals.run()


def _rank(gateway: Any, scene: str, **more: Any) -> Any:
    return gateway.client.post(f"/v1/scenes/{scene}/rankings", json={**QUESTION, **more})


def _rows(gateway: Any, scene: str) -> dict[str, int]:
    """The number of rows with this scene's id in every table that has such a column."""
    with gateway.application.storage.database.reading() as session:
        return {
            table.name: session.scalar(
                select(func.count()).select_from(table).where(table.c.scene_id == scene)
            )
            for table in Table.metadata.sorted_tables
            if "scene_id" in table.c and table.name != "api_keys"
        }


def _killed(*_arguments: object) -> None:
    raise KeyboardInterrupt


def test_a_deleted_scene_is_gone_with_all_that_it_had(gateway: Any, photograph: Any) -> None:
    scene, other = gateway.scene(), gateway.scene()
    image = gateway.put(scene, photograph(1)).json()["digest"]
    gateway.put(other, photograph(1))
    snapshot = gateway.model(scene)
    ranking = _rank(gateway, scene).json()
    render = f"/v1/rankings/{ranking['id']}/candidates/{ranking['candidates'][0]['id']}/render.png"
    assert gateway.client.get(render).status_code == 200
    queued = gateway.queue(scene)
    assert _files(gateway, scene)
    assert gateway.client.delete(f"/v1/scenes/{scene}").status_code == 204
    for path in (
        *(f"/v1/scenes/{scene}{rest}" for rest in ("", "/size", "/images", "/jobs", "/snapshots", "/events")),
        *(f"/v1/scenes/{scene}/images/{image}", f"/v1/jobs/{queued}", f"/v1/snapshots/{snapshot}"),
        *(f"/v1/snapshots/{snapshot}/artifacts/cameras.json", f"/v1/rankings/{ranking['id']}", render),
    ):
        assert gateway.client.get(path).status_code == 404, path
    assert gateway.client.delete(f"/v1/scenes/{scene}").status_code == 404
    assert gateway.put(scene, photograph(2)).status_code == 404
    assert scene not in gateway.client.get("/v1/scenes?limit=1000").text
    left = {name: count for name, count in _rows(gateway, scene).items() if count}
    assert left == {"events": 1, "removals": 1}
    _remove(gateway)
    assert _files(gateway, scene) == set()
    assert _files(gateway, other)


def test_what_an_upload_writes_after_its_scene_was_deleted_is_removed(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.client.delete(f"/v1/scenes/{scene}")
    _remove(gateway, later=False)
    gateway.application.storage.blobs.put(b"late", f"scenes/{scene}/images/{'0' * 64}")
    _remove(gateway)
    assert _files(gateway, scene) == set()


def test_a_removal_that_was_interrupted_goes_on(
    gateway: Any, photograph: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    gateway.model(scene)
    gateway.client.delete(f"/v1/scenes/{scene}")
    storage = gateway.application.storage
    with monkeypatch.context() as patch:
        patch.setattr(storage.blobs, "remove_below", _killed)
        with pytest.raises(KeyboardInterrupt):
            storage.removals.run()
    assert gateway.client.get(f"/v1/scenes/{scene}").status_code == 404
    Removals(storage.database, storage.blobs, 0).run()
    assert _files(gateway, scene) == set()


def test_of_two_deletions_at_once_one_finds_nothing(gateway: Any) -> None:
    for _ in range(5):
        scene = gateway.scene()
        with concurrent.futures.ThreadPoolExecutor(4) as pool:
            answers = [pool.submit(gateway.client.delete, f"/v1/scenes/{scene}") for _ in range(4)]
        assert sorted(answer.result().status_code for answer in answers) == [204, 404, 404, 404]


def test_the_worker_of_a_deleted_scene_stops_and_changes_nothing(gateway: Any) -> None:
    scene = gateway.scene()
    job, lease = gateway.queue(scene), gateway.lease(scene)
    storage = gateway.application.storage
    storage.ledger.start(lease, job, 1)
    gateway.client.delete(f"/v1/scenes/{scene}")
    assert storage.ledger.cancel_requested(job)
    for write in (
        lambda: storage.leases.extend(lease),
        lambda: storage.ledger.succeed(lease, job),
        lambda: storage.ledger.report(lease, job, "training", 0.5),
    ):
        with pytest.raises(StaleLeaseError):
            write()
    assert _rows(gateway, scene)["jobs"] == 0


def test_a_ranking_that_is_computed_while_its_scene_is_deleted_leaves_nothing(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    runners = gateway.runners
    computing, deleted, rank = threading.Event(), threading.Event(), runners.rank

    async def slow(request: Any) -> Any:
        ranked = await rank(request)
        computing.set()
        assert await run_sync(deleted.wait, 60)
        return ranked

    runners.rank = slow
    try:
        with concurrent.futures.ThreadPoolExecutor(1) as pool:
            answer = pool.submit(_rank, gateway, scene)
            assert computing.wait(60)
            gateway.client.delete(f"/v1/scenes/{scene}")
            deleted.set()
            assert answer.result().status_code == 404
    finally:
        runners.rank = rank
    assert _rows(gateway, scene)["rankings"] == 0


def test_event_streams_of_a_deleted_scene_end(serve: Any) -> None:
    gateway = serve()
    scene = gateway.scene()
    with gateway.client.stream("GET", f"/v1/scenes/{scene}/events") as stream:
        lines = stream.iter_lines()
        while next(lines) != "event: scene.created":
            pass
        gateway.client.delete(f"/v1/scenes/{scene}")
        kinds = [line for line in lines if line.startswith("event:")]
    assert kinds == ["event: scene.deleted"]


def test_snapshots_are_deleted_but_never_the_current_one_or_a_pinned_one(gateway: Any) -> None:
    scene = gateway.scene()
    first, second, third = (gateway.model(scene) for _ in range(3))
    ranking = _rank(gateway, scene, snapshot_id=first).json()
    assert _rank(gateway, scene, snapshot_id=second).status_code == 201
    gateway.client.patch(f"/v1/snapshots/{second}", json={"pinned": True})
    for kept in (second, third):
        assert gateway.client.delete(f"/v1/snapshots/{kept}").status_code == 409
    assert gateway.client.delete(f"/v1/snapshots/{first}").status_code == 204
    assert gateway.client.get(f"/v1/snapshots/{first}").status_code == 404
    assert _rank(gateway, scene, snapshot_id=first).status_code == 404
    assert gateway.client.get(f"/v1/rankings/{ranking['id']}").json() == ranking
    render = f"/v1/rankings/{ranking['id']}/candidates/{ranking['candidates'][0]['id']}/render.png"
    assert gateway.client.get(render).status_code == 404
    left = gateway.client.get(f"/v1/scenes/{scene}/snapshots").json()["items"]
    assert [(item["id"], item["pinned"]) for item in left] == [(third, False), (second, True)]
    _remove(gateway)
    assert not any(first in file for file in _files(gateway, scene))
    for snapshot in left:
        for artifact in snapshot["artifacts"]:
            path = f"/v1/snapshots/{snapshot['id']}/artifacts/{artifact['name']}"
            assert len(gateway.client.get(path).content) == artifact["size_bytes"]
    gateway.client.patch(f"/v1/snapshots/{second}", json={"pinned": False})
    assert gateway.client.delete(f"/v1/snapshots/{second}").status_code == 204


def test_a_deleted_ranking_is_gone_with_its_renders(gateway: Any) -> None:
    scene = gateway.scene()
    gateway.model(scene)
    ranking = _rank(gateway, scene).json()
    path = f"/v1/rankings/{ranking['id']}"
    gateway.client.get(f"{path}/candidates/{ranking['candidates'][0]['id']}/render.png")
    before = _files(gateway, scene)
    assert any(file.startswith("rankings/") for file in before)
    assert gateway.client.delete(path).status_code == 204
    assert gateway.client.get(path).status_code == 404
    _remove(gateway)
    assert _files(gateway, scene) == {file for file in before if not file.startswith("rankings/")}


def test_a_key_of_a_request_whose_resource_was_deleted_creates_no_other(gateway: Any) -> None:
    key = {"Idempotency-Key": "once-and-no-more"}
    create = {"json": {"name": "a"}, "headers": key}
    scene = gateway.client.post("/v1/scenes", **create).json()["id"]
    assert gateway.client.post("/v1/scenes", **create).json()["id"] == scene
    gateway.client.delete(f"/v1/scenes/{scene}")
    again = gateway.client.post("/v1/scenes", **create)
    assert (again.status_code, again.json()["code"]) == (410, "gone")
    assert scene in again.json()["detail"]


def test_equal_artifacts_are_stored_once(gateway: Any) -> None:
    scene = gateway.scene()
    for _ in range(3):
        gateway.model(scene)
    snapshots = gateway.client.get(f"/v1/scenes/{scene}/snapshots").json()["items"]
    digests = [{item["name"]: item["sha256"] for item in one["artifacts"]} for one in snapshots]
    assert len({one["cameras.json"] for one in digests}) == 1
    assert len({one["point_cloud.ply"] for one in digests}) == 3
    assert len([file for file in _files(gateway, scene) if file.startswith("artifacts/")]) == 4
    size = gateway.client.get(f"/v1/scenes/{scene}/size").json()
    sizes = {item["sha256"]: item["size_bytes"] for one in snapshots for item in one["artifacts"]}
    assert size["artifacts_bytes"] == sum(sizes.values())


def test_an_update_that_changes_nothing_makes_no_snapshot(gateway: Any) -> None:
    scene = gateway.scene()
    snapshot = gateway.model(scene)
    assert gateway.model(scene, seed=5) == snapshot
    jobs = gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]
    assert [job["snapshot_id"] for job in jobs] == [snapshot, snapshot]
    assert jobs[0]["state"] == "succeeded"
    assert [warning["texts"] for warning in jobs[0]["warnings"]] == [{"snapshot": snapshot}]
    assert len(gateway.client.get(f"/v1/scenes/{scene}/snapshots").json()["items"]) == 1


def test_scenes_of_one_name_are_renamed_and_deleted_one_by_one(gateway: Any) -> None:
    first, second = gateway.scene(name="twin"), gateway.scene(name="twin")
    renamed = gateway.client.patch(f"/v1/scenes/{second}", json={"name": "second twin"})
    assert renamed.json()["name"] == "second twin"
    changed = gateway.client.patch(f"/v1/scenes/{second}", json={"retention": {"snapshots": 2}}).json()
    assert (changed["name"], changed["retention"]["snapshots"]) == ("second twin", 2)
    policy = {"trigger": "every-k-images", "k": 3, "first": 4}
    assert gateway.client.patch(f"/v1/scenes/{second}", json={"policy": policy}).json()["policy"] == policy
    assert gateway.client.get(f"/v1/scenes/{first}").json()["name"] == "twin"
    assert gateway.client.patch(f"/v1/scenes/{second}", json={}).status_code == 422
    assert gateway.client.delete(f"/v1/scenes/{first}").status_code == 204
    assert gateway.client.get(f"/v1/scenes/{second}").status_code == 200


def test_the_size_of_a_scene_is_told(gateway: Any, photograph: Any) -> None:
    scene = gateway.scene()
    contents = [photograph(seed) for seed in (1, 2)]
    images = [gateway.put(scene, content).json()["digest"] for content in (*contents, contents[0])]
    kept = [f"/v1/scenes/{scene}/images/{image}/thumbnail" for image in {*images}]
    thumbnails = [gateway.client.get(path).content for path in kept]
    size = gateway.client.get(f"/v1/scenes/{scene}/size").json()
    assert size["images_bytes"] == sum(map(len, (*contents, *thumbnails)))
    assert (size["artifacts_bytes"], size["working_bytes"]) == (0, 0)
    assert size["total_bytes"] == size["images_bytes"]


def test_the_blob_of_a_snapshot_that_is_committed_while_an_equal_one_is_removed_stays(
    gateway: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The artifact was there when it was stored, and is removed before the new reference is committed."""
    scene = gateway.scene()
    first = gateway.model(scene)
    storage = gateway.application.storage
    (cameras,) = (
        item
        for item in gateway.client.get(f"/v1/snapshots/{first}").json()["artifacts"]
        if item["name"] == "cameras.json"
    )
    key, kept, removed = f"scenes/{scene}/artifacts/{cameras['sha256']}", storage.blobs.put, []

    def put_and_lose(content: bytes, manifest: str) -> None:
        kept(content, manifest)
        if not removed:
            removed.append(key)
            storage.blobs.remove(key)

    monkeypatch.setattr(storage.blobs, "put", put_and_lose)
    gateway.model(scene)
    assert removed
    assert storage.blobs.exists(key)


def test_blobs_are_kept_and_listed(tmp_path: Path, gateway: Any) -> None:
    blobs = gateway.application.storage.blobs
    file = tmp_path / "artifact"
    file.write_bytes(b"content")
    for _ in range(2):
        blobs.keep(file, "scenes/s/artifacts/x")
    file.write_bytes(b"changed")
    assert blobs.read("scenes/s/artifacts/x") == b"content"
    assert [(found.key, found.size_bytes) for found in blobs.below("scenes/s/")] == [
        ("scenes/s/artifacts/x", 7)
    ]
    blobs.remove("scenes/s/artifacts/x")
    blobs.remove("scenes/s/artifacts/x")
    assert not blobs.exists("scenes/s/artifacts/x")
    assert list(blobs.below("scenes/s/")) == []
