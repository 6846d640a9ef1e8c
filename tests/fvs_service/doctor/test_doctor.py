"""The doctor finds what crashes leave behind, repairs it, and touches nothing else."""

import dataclasses
import os
import time
from collections.abc import Callable
from datetime import timedelta
from pathlib import Path
from typing import Any

import pytest
from fvs_service.application import open_storage
from fvs_service.auth import Keys
from fvs_service.cli.serve import add_commands
from fvs_service.doctor.deployment import troubles
from fvs_service.doctor.examination import examine
from fvs_service.errors import StorageRefusedError
from fvs_service.host.worker.heartbeat import Heartbeats
from fvs_service.settings import Settings
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from fvs_service.storage.owner import OWNER_KEY, claim_store
from fvs_service.storage.tables import ImageRow, RemovalRow, WorkerRow
from sqlalchemy import delete, update
from typer import Typer
from typer.testing import CliRunner
from videos import textured, write_video

NONE = timedelta(0)


@pytest.fixture
def gateway(open_gateway: Any, photograph: Any) -> Any:
    """A gateway with a scene that has everything."""
    gateway = open_gateway()
    scene = gateway.scene()
    gateway.put(scene, photograph(1))
    gateway.model(scene)
    ranking = gateway.client.post(
        f"/v1/scenes/{scene}/rankings", json={"generator": {"kind": "orbit", "count": 8}}
    ).json()
    gateway.client.get(f"/v1/rankings/{ranking['id']}/candidates/{ranking['candidates'][0]['id']}/render.png")
    gateway.queue(scene)
    (gateway.settings.scenes / scene).mkdir(parents=True)
    return gateway


def _kinds(gateway: Any, grace: timedelta = NONE) -> list[str]:
    return [finding.kind for finding in examine(gateway.application.storage, grace)]


def _repair(gateway: Any) -> None:
    for _ in range(2):  # what a deletion leaves is removed in a second examination
        for finding in examine(gateway.application.storage, NONE):
            finding.repair()
            finding.repair()


def _scene(gateway: Any) -> str:
    return gateway.client.get("/v1/scenes").json()["items"][0]["id"]


def test_a_healthy_service_has_nothing(gateway: Any) -> None:
    assert _kinds(gateway) == []


def test_what_was_deleted_and_waits_for_its_removal_is_no_finding(gateway: Any) -> None:
    scene = _scene(gateway)
    first = gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
    gateway.model(scene)
    assert gateway.client.delete(f"/v1/snapshots/{first}").status_code == 204
    gateway.application.storage.removals.run()
    assert _kinds(gateway) == []


def test_every_orphan_is_found_and_repaired(gateway: Any) -> None:
    storage, scene = gateway.application.storage, _scene(gateway)
    for key in (
        *(f"scenes/{scene}/images/{'0' * 64}", f"scenes/{scene}/artifacts/{'0' * 64}"),
        *(f"scenes/{scene}/snapshots/snp_none.json", f"scenes/{scene}/rankings/rnk_none/x/render.png"),
        "scenes/scn_none/images/0",
    ):
        storage.blobs.put(b"nobody's", key)
    (gateway.settings.root / "blobs" / ".0.partial").write_bytes(b"half")
    (gateway.settings.scenes / "scn_none").mkdir()
    (gateway.settings.uploads / "1.part").write_bytes(b"half")
    deleted = gateway.scene()
    gateway.client.delete(f"/v1/scenes/{deleted}")
    found = [
        "half deletion",
        *["blob without row"] * 5,
        "unfinished write",
        "working folder of no scene",
        "abandoned upload",
    ]
    time.sleep(0.05)
    assert _kinds(gateway) == found
    assert _kinds(gateway, timedelta(hours=1)) == [], "new ones may be in progress"
    _repair(gateway)
    assert _kinds(gateway) == []
    assert gateway.client.get(f"/v1/scenes/{scene}").status_code == 200


def test_a_deletion_that_waits_for_too_long_is_found(gateway: Any) -> None:
    storage = gateway.application.storage
    scene = gateway.scene()
    gateway.client.delete(f"/v1/scenes/{scene}")
    assert _kinds(gateway, timedelta(minutes=15)) == []
    with storage.database.writing() as session:
        session.execute(update(RemovalRow).values(due_at=now() - timedelta(hours=1)))
    assert _kinds(gateway, timedelta(minutes=15)) == ["half deletion"]


def test_a_video_without_bytes_is_forgotten(gateway: Any, tmp_path: Any) -> None:
    scene = gateway.scene()
    clip = write_video(tmp_path / "a.mp4", [(0.0, textured()), (1.0, textured())]).read_bytes()
    gateway.put(scene, clip, name="a.mp4")
    assert _kinds(gateway) == []
    for file in gateway.settings.root.glob(f"blobs/scenes/{scene}/videos/*"):
        file.unlink()
    assert _kinds(gateway) == ["image without blob"]
    _repair(gateway)
    assert gateway.put(scene, clip, name="a.mp4").status_code == 201


def test_images_without_bytes_are_forgotten_and_can_be_sent_again(gateway: Any, photograph: Any) -> None:
    scene = _scene(gateway)
    for file in gateway.settings.root.glob(f"blobs/scenes/{scene}/images/*"):
        file.unlink()
    assert gateway.put(scene, photograph(1)).status_code == 200, "the bytes are thought to be there"
    assert _kinds(gateway) == ["image without blob"]
    _repair(gateway)
    assert gateway.put(scene, photograph(1)).status_code == 201
    assert _kinds(gateway) == []


def test_a_broken_current_snapshot_gives_way_to_the_newest_whole_one(gateway: Any) -> None:
    scene = _scene(gateway)
    whole = gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"]
    broken = gateway.client.get(f"/v1/snapshots/{gateway.model(scene)}").json()
    sha256 = next(one["sha256"] for one in broken["artifacts"] if one["name"] == "point_cloud.ply")
    gateway.application.storage.blobs.remove(f"scenes/{scene}/artifacts/{sha256}")
    assert _kinds(gateway) == ["snapshot without blob"]
    _repair(gateway)
    assert gateway.client.get(f"/v1/scenes/{scene}").json()["snapshot_id"] == whole
    assert gateway.client.get(f"/v1/snapshots/{broken['id']}").status_code == 404
    ranked = gateway.client.post(
        f"/v1/scenes/{scene}/rankings", json={"generator": {"kind": "orbit", "count": 8}}
    )
    assert ranked.status_code == 201
    assert _kinds(gateway) == []


def test_the_command_says_what_it_finds_and_mends_only_when_asked(gateway: Any) -> None:
    app = Typer()
    add_commands(app)

    def run(*words: str) -> Any:
        return CliRunner().invoke(app, ["doctor", "--root", str(gateway.settings.root), *words])

    assert (run().exit_code, run().stdout) == (0, "")
    orphan = gateway.settings.scenes / "scn_none"
    orphan.mkdir()
    os.utime(orphan, (1, 1))
    for _ in range(2):
        found = run()
        assert (found.exit_code, orphan.exists()) == (13, True)
        assert str(orphan) in found.stdout
    assert run("--repair").exit_code == 13
    assert (run().exit_code, orphan.exists()) == (0, False)


def test_a_deployment_that_works_has_no_troubles(open_gateway: Callable[..., Any]) -> None:
    storage = open_gateway().application.storage
    Heartbeats(storage.database, "worker-0").beat()
    assert list(troubles(storage)) == []


def test_the_doctor_says_what_is_wrong_with_a_deployment(
    open_gateway: Callable[..., Any], monkeypatch: pytest.MonkeyPatch
) -> None:
    storage = open_gateway().application.storage
    Heartbeats(storage.database, "worker-0").beat(disk_full=True)
    Heartbeats(storage.database, "worker-1").beat()
    Heartbeats(storage.database, "worker-2").beat(slots=0)
    with storage.database.writing() as session:
        session.execute(update(WorkerRow).where(WorkerRow.id == "worker-1").values(beaten_at_ms=0))
    ten_minutes_later = time.time() + 600
    monkeypatch.setattr("fvs_service.doctor.deployment.time.time", lambda: ten_minutes_later)
    monkeypatch.setattr(Blobs, "check", refuse)
    found = list(troubles(storage))
    assert [trouble.serious for trouble in found] == [True, False, False, False, False]
    said = " ".join(trouble.what for trouble in found)
    for part in (
        "no such bucket",
        "600 s ahead of",
        "worker-0 takes no jobs",
        "worker-1 has sent no heartbeat",
        "worker-2 takes no jobs: it cannot reach its Ray cluster",
    ):
        assert part in said


@pytest.mark.parametrize("lost", ["blobs", "database"])
def test_a_database_and_a_store_that_do_not_know_each_other_stay_as_they_are(gateway: Any, lost: str) -> None:
    scene, storage = _scene(gateway), gateway.application.storage
    if lost == "blobs":
        for blob in list(storage.blobs.below(f"scenes/{scene}/images/")):
            storage.blobs.remove(blob.key)
    if lost == "database":
        with storage.database.writing() as session:
            session.execute(delete(ImageRow))
            session.execute(delete(RemovalRow))
    (trouble,) = (trouble for trouble in troubles(storage) if trouble.serious)
    assert "know" in trouble.what
    assert "restore a backup" in trouble.hint


def test_a_store_of_another_database_is_neither_served_nor_repaired(
    gateway: Any, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each knows some images in the store, and those of the other would be blobs without rows."""
    storage = gateway.application.storage
    claim_store(storage.database, storage.blobs)
    claim_store(storage.database, storage.blobs)
    images = [blob.key for blob in storage.blobs.below("scenes/")]
    monkeypatch.setenv("FVS_DATABASE_URL", f"sqlite:///{tmp_path / 'another.sqlite3'}")
    theirs = Settings(root=gateway.settings.root)
    refused = pytest.raises(StorageRefusedError, match="belongs to another database")
    with open_storage(theirs) as another, refused:
        claim_store(another.database, another.blobs)
    app = Typer()
    add_commands(app)
    root = str(gateway.settings.root)
    repaired = CliRunner().invoke(app, ["doctor", "--root", root, "--grace", "0", "--repair"])
    assert repaired.exit_code == 13
    assert "belongs to another database" in repaired.stdout
    served = CliRunner().invoke(app, ["serve", "--root", root, "--port", "0"])
    assert served.exit_code != 0
    assert "belongs to another database" in served.stderr
    assert [blob.key for blob in storage.blobs.below("scenes/")] == images
    storage.blobs.remove(OWNER_KEY)
    refused = pytest.raises(StorageRefusedError, match="knows no images")
    with open_storage(theirs) as another, refused:
        claim_store(another.database, another.blobs)
    for blob in list(storage.blobs.below("scenes/")):
        storage.blobs.remove(blob.key)
    with open_storage(theirs) as another:
        claim_store(another.database, another.blobs)
    with pytest.raises(StorageRefusedError, match="belongs to another database"):
        claim_store(storage.database, storage.blobs)


def test_the_doctor_names_a_folder_of_gpu_memory_that_another_user_has_made(
    open_gateway: Callable[..., Any], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    storage = open_gateway().application.storage
    Heartbeats(storage.database, "worker-0").beat()
    (tmp_path / "fvs-gpu-memory").symlink_to(tmp_path)
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (trouble,) = troubles(storage)
    assert "fvs-gpu-memory is not a folder of this user" in trouble.what
    assert "XDG_RUNTIME_DIR" in trouble.hint


def refuse(_blobs: Blobs) -> None:
    raise StorageRefusedError("The object store has no such bucket.", hint="Create it.")


def test_a_deployment_whose_storage_is_elsewhere_needs_the_root_named(
    open_gateway: Callable[..., Any], tmp_path: Path
) -> None:
    storage = open_gateway().application.storage
    elsewhere = storage.settings.model_copy(update={"root": tmp_path / "typo"})
    (trouble,) = troubles(dataclasses.replace(storage, settings=elsewhere))
    assert str(tmp_path / "typo") in trouble.what
    assert "--root" in trouble.hint


def test_the_doctor_says_who_may_get_in(open_gateway: Callable[..., Any]) -> None:
    storage = open_gateway().application.storage
    Heartbeats(storage.database, "worker-0").beat()

    def found(**changed: Any) -> tuple[str, ...]:
        settings = storage.settings.model_copy(update=changed)
        keys = Keys(storage.database, required=settings.keys_required)
        examined = troubles(dataclasses.replace(storage, settings=settings, keys=keys))
        return tuple(trouble.what for trouble in examined)

    assert found() == found(require_keys=False) == ()
    (closed,) = found(allowed_hosts=("ground.example",))
    assert "may reach the service as ground.example, and no key is valid" in closed
    (open_to_all,) = found(allowed_hosts=("ground.example",), require_keys=False)
    assert "Whoever reaches the service as ground.example may use it" in open_to_all
    storage.keys.create("a")
    assert found(allowed_hosts=("ground.example",)) == found() == ()
