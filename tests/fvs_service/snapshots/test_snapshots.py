import hashlib
from pathlib import Path
from typing import Any

import pytest
from fvs_service.errors import RangeError, StaleLeaseError
from fvs_service.gateway.rest.ranges import byte_range
from hypothesis import given
from hypothesis import strategies as st

from fvs_schema.findings import Finding, FindingCode
from fvs_schema.scenes import Alignment


@pytest.fixture(scope="module")
def snapshot(gateway: Any) -> dict[str, Any]:
    scene = gateway.scene()
    return gateway.client.get(f"/v1/snapshots/{gateway.model(scene)}").json()


@pytest.fixture(scope="module")
def ply(gateway: Any, snapshot: dict[str, Any]) -> tuple[str, bytes]:
    path = f"/v1/snapshots/{snapshot['id']}/artifacts/point_cloud.ply"
    return path, gateway.client.get(path).content


def test_a_snapshot_lists_what_it_has(gateway: Any, snapshot: dict[str, Any]) -> None:
    assert [artifact["name"] for artifact in snapshot["artifacts"]] == ["cameras.json", "point_cloud.ply"]
    scene = gateway.client.get(f"/v1/scenes/{snapshot['scene_id']}").json()
    assert scene["snapshot_id"] == snapshot["id"]
    assert scene["alignment"] == snapshot["alignment"]
    listed = gateway.client.get(f"/v1/scenes/{snapshot['scene_id']}/snapshots").json()["items"]
    assert listed == [snapshot]
    job = gateway.client.get(f"/v1/jobs/{snapshot['job_id']}").json()
    assert job["snapshot_id"] == snapshot["id"]


def test_an_artifact_is_downloaded_whole(gateway: Any, snapshot: dict[str, Any], ply: Any) -> None:
    path, content = ply
    (artifact,) = [item for item in snapshot["artifacts"] if item["name"] == "point_cloud.ply"]
    assert len(content) == artifact["size_bytes"]
    assert hashlib.sha256(content).hexdigest() == artifact["sha256"]
    answer = gateway.client.get(path)
    assert answer.headers["etag"] == f'"{artifact["sha256"]}"'
    assert answer.headers["accept-ranges"] == "bytes"
    assert gateway.client.get(path, headers={"If-None-Match": answer.headers["etag"]}).status_code == 304
    head = gateway.client.head(path)
    assert (head.status_code, head.headers["content-length"]) == (200, str(len(content)))


def test_the_document_names_the_types_of_artifacts(gateway: Any, snapshot: dict[str, Any]) -> None:
    paths = gateway.client.get("/openapi.json").json()["paths"]
    answers = paths["/v1/snapshots/{snapshot_id}/artifacts/{name}"]["get"]["responses"]
    for artifact in snapshot["artifacts"]:
        assert artifact["media_type"] in answers["200"]["content"]
        assert artifact["media_type"] in answers["206"]["content"]


def test_an_interrupted_download_goes_on(gateway: Any, ply: Any) -> None:
    path, content = ply
    tag = gateway.client.get(path).headers["etag"]
    rest = gateway.client.get(path, headers={"Range": "bytes=100-", "If-Range": tag})
    assert rest.status_code == 206
    assert rest.headers["content-range"] == f"bytes 100-{len(content) - 1}/{len(content)}"
    assert content[:100] + rest.content == content
    changed = gateway.client.get(path, headers={"Range": "bytes=100-", "If-Range": '"another"'})
    assert (changed.status_code, changed.content) == (200, content)


def test_a_range_after_the_end_is_a_problem(gateway: Any, ply: Any) -> None:
    path, content = ply
    answer = gateway.client.get(path, headers={"Range": f"bytes={len(content)}-"})
    assert answer.status_code == 416
    assert answer.headers["content-range"] == f"bytes */{len(content)}"
    assert answer.json()["code"] == "range-not-satisfiable"


@given(
    st.binary(min_size=1, max_size=40),
    st.one_of(st.none(), st.integers(0, 50)),
    st.one_of(st.none(), st.integers(0, 50)),
)
def test_ranges_mean_what_the_standard_says(content: bytes, first: int | None, last: int | None) -> None:
    header = f"bytes={'' if first is None else first}-{'' if last is None else last}"
    if first is None and last is None:
        wanted: bytes | None = content
    elif first is None:
        wanted = content[-last:] if last else None
    elif last is not None and last < first:
        wanted = content  # not a range at all
    else:
        wanted = content[first:] if last is None else content[first : last + 1]
    if not wanted:
        with pytest.raises(RangeError):
            byte_range(header, len(content))
        return
    start, stop = byte_range(header, len(content)) or (0, len(content))
    assert content[start:stop] == wanted


@pytest.mark.parametrize("header", [None, "", "bytes", "bytes=", "lines=0-1", "bytes=a-b", "bytes=0-1,3-4"])
def test_what_is_no_single_range_is_ignored(header: str | None) -> None:
    assert byte_range(header, 10) is None


@pytest.mark.parametrize("name", ["missing.ply", "..%2f..%2fcameras.json", "%2e%2e", "cameras.json%00"])
def test_only_listed_artifacts_are_read(gateway: Any, snapshot: dict[str, Any], name: str) -> None:
    answer = gateway.client.get(f"/v1/snapshots/{snapshot['id']}/artifacts/{name}")
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


def test_a_snapshot_is_committed_once_per_stage(gateway: Any, tmp_path: Path) -> None:
    """A worker that died after the commit repeats the stage: the first snapshot stands."""
    from fvs_service.snapshots.service import NewSnapshot

    scene = gateway.scene()
    first = gateway.model(scene)
    storage = gateway.application.storage
    job_id = gateway.client.get(f"/v1/snapshots/{first}").json()["job_id"]
    from fvs_service.jobs.repository import find_job

    with storage.database.reading() as session:
        job = find_job(session, job_id)
    (tmp_path / "cameras.json").write_text("{}")
    again = NewSnapshot(
        metrics=storage.snapshots.get(_local(), first).metrics,
        alignment=Alignment(),
        files={"cameras.json": tmp_path / "cameras.json"},
        registered=(),
        unregistered={},
    )
    lease = gateway.lease(scene)
    assert storage.snapshots.commit(lease, job, "snapshot", again).id == first
    second = storage.snapshots.commit(lease, job, "another stage", again)
    assert second.id != first
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"] == second.id


def test_a_model_that_comes_back_is_the_latest_again(gateway: Any) -> None:
    """An image was excluded and included: its models are bit by bit those that were before."""

    def latest() -> tuple[str, list[dict[str, Any]]]:
        found = gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
        jobs = gateway.client.get(f"/v1/scenes/{scene}/jobs").json()["items"]
        return found, max(jobs, key=lambda job: job["id"])["warnings"]

    scene = gateway.scene()
    with_it = gateway.model(scene, seed=1)
    without = gateway.model(scene, seed=2)
    assert latest() == (without, [])
    assert gateway.model(scene, seed=1) == with_it
    assert latest() == (with_it, [])
    assert gateway.model(scene, seed=1) == with_it
    assert latest()[0] == with_it
    assert [warning["code"] for warning in latest()[1]] == ["update-unchanged"]


def test_a_fine_model_that_knows_fewer_images_does_not_guide(gateway: Any, tmp_path: Path) -> None:
    """Updates came while it was trained: rankings go on with the model that knows their images."""
    from fvs_service.jobs.repository import find_job
    from fvs_service.snapshots.service import NewSnapshot

    scene, storage = gateway.scene(), gateway.application.storage
    update = gateway.model(scene)
    job_id, lease = gateway.queue(scene, "fine"), gateway.lease(scene)
    storage.ledger.start(lease, job_id, 1)
    with storage.database.reading() as session:
        job = find_job(session, job_id)
    metrics = storage.snapshots.get(_local(), update).metrics

    def commit(stage: str, registered: int) -> str:
        (tmp_path / "cameras.json").write_text("{}")
        made = NewSnapshot(
            metrics.model_copy(update={"registered": registered}),
            Alignment(),
            {"cameras.json": tmp_path / "cameras.json"},
            (),
            {},
        )
        return storage.snapshots.commit(lease, job, stage, made).id

    behind = commit("behind", metrics.registered - 1)
    assert gateway.client.get(f"/v1/jobs/{job_id}").json()["snapshot_id"] == behind
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"] == update
    level = commit("level", metrics.registered)
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"] == level


def test_a_snapshot_of_a_lost_lease_is_not_committed(gateway: Any, tmp_path: Path) -> None:
    from fvs_service.jobs.repository import find_job
    from fvs_service.snapshots.service import NewSnapshot

    scene, storage = gateway.scene(), gateway.application.storage
    job_id, frozen = gateway.queue(scene), gateway.lease(scene, "frozen")
    storage.ledger.start(frozen, job_id, 1)
    storage.leases.release(frozen)
    gateway.lease(scene, "other")
    with storage.database.reading() as session:
        job = find_job(session, job_id)
    (tmp_path / "cameras.json").write_text("{}")
    metrics = {
        "registered": 2,
        "unregistered": 0,
        "points": 1,
        "iterations": 1,
        "gaussians": 1,
        "sh_degree": 0,
    }
    from fvs_schema.snapshots import SnapshotMetrics

    made = NewSnapshot(
        SnapshotMetrics(**metrics), Alignment(), {"cameras.json": tmp_path / "cameras.json"}, (), {}
    )
    with pytest.raises(StaleLeaseError):
        storage.snapshots.commit(frozen, job, "snapshot", made)
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"] is None


def test_images_show_what_became_of_them(gateway: Any, photograph: Any, tmp_path: Path) -> None:
    from fvs_service.jobs.repository import find_job
    from fvs_service.snapshots.service import NewSnapshot

    from fvs_schema.snapshots import SnapshotMetrics

    scene, storage = gateway.scene(), gateway.application.storage
    digests = [gateway.put(scene, photograph(seed)).json()["digest"] for seed in range(3)]
    job_id, lease = gateway.queue(scene), gateway.lease(scene)
    storage.ledger.start(lease, job_id, 1)
    with storage.database.reading() as session:
        job = find_job(session, job_id)
    (tmp_path / "cameras.json").write_text("{}")
    metrics = {
        "registered": 1,
        "unregistered": 1,
        "points": 1,
        "iterations": 1,
        "gaussians": 1,
        "sh_degree": 0,
    }

    def commit(
        stage: str, registered: list[str], unregistered: dict[str, Finding | None]
    ) -> list[dict[str, Any]]:
        made = NewSnapshot(
            SnapshotMetrics(**metrics),
            Alignment(),
            {"cameras.json": tmp_path / "cameras.json"},
            registered=registered,
            unregistered=unregistered,
        )
        storage.snapshots.commit(lease, job, stage, made)
        items: list[dict[str, Any]] = gateway.client.get(f"/v1/scenes/{scene}/images").json()["items"]
        return items

    unmatched = Finding.of(FindingCode.UNMATCHED)
    items = commit("first", digests[:1], {digests[1]: unmatched})
    assert [item["registration"] for item in items] == ["registered", "unregistered", "pending"]
    assert [item["reason"] for item in items] == [
        "",
        f"Not registered, as no other image matches: {items[1]['name']}.",
        "",
    ]
    assert [item["finding"] for item in items] == [None, "unmatched", None]
    assert items[1]["hint"].startswith("Photograph what lies between")
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["image_counts"]["pending"] == 1

    items = commit("second", digests[1:], {digests[0]: None})
    assert [item["registration"] for item in items] == ["unregistered", "registered", "registered"]
    assert [item["reason"] + item["hint"] for item in items] == ["", "", ""]


def _local() -> Any:
    from fvs_service.principal import LOCAL_USER

    return LOCAL_USER
