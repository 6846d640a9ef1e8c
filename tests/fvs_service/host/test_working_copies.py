"""Working copies carry a scene's folder from one machine to another."""

import dataclasses
from collections.abc import Callable
from pathlib import Path

import pytest
from fvs_service.application import Storage
from fvs_service.errors import StaleLeaseError
from fvs_service.host.worker.working_copies import WorkingCopies
from fvs_service.scenes.lease import Lease
from fvs_service.storage.blobs import Blobs


@pytest.fixture
def machines(
    open_gateway: Callable[..., object], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[Storage, Storage, str]:
    """The storage as two machines see it, and a scene."""
    gateway = open_gateway()
    monkeypatch.setattr(Blobs, "shared", True)
    storage = gateway.application.storage
    seen = [
        dataclasses.replace(storage, settings=storage.settings.model_copy(update={"root": tmp_path / name}))
        for name in ("a", "b")
    ]
    return seen[0], seen[1], gateway.scene()


def folder_of(storage: Storage, scene: str) -> Path:
    folder = storage.settings.scenes / scene
    (folder / "growing").mkdir(parents=True, exist_ok=True)
    return folder


def lease_of(storage: Storage, scene: str, worker: str) -> Lease:
    """The lease, taken from whoever has it."""
    holder = storage.leases.holder(scene)
    if holder is not None:
        storage.leases.release(holder)
    lease = storage.leases.acquire(scene, worker)
    assert lease is not None
    return lease


def test_the_next_machine_goes_on_from_what_the_last_one_had(machines: tuple[Storage, Storage, str]) -> None:
    first, second, scene = machines
    ours, theirs = folder_of(first, scene), folder_of(second, scene)
    (ours / "growing" / "model").write_text("one image")
    (ours / "choice.json").write_text("{}")
    (theirs / "growing" / "left-over").write_text("of a try that was not committed")
    WorkingCopies(first).store(lease_of(first, scene, "a"))

    WorkingCopies(second).restore(scene)
    assert sorted(file.name for file in (theirs / "growing").iterdir()) == ["model"]
    (theirs / "growing" / "model").write_text("two images")
    WorkingCopies(second).restore(scene)  # of what it has already
    assert (theirs / "growing" / "model").read_text() == "two images"
    WorkingCopies(second).store(lease_of(second, scene, "b"))

    WorkingCopies(first).restore(scene)
    assert (ours / "growing" / "model").read_text() == "two images"
    assert (ours / "choice.json").read_text() == "{}"


def test_a_worker_that_lost_its_lease_stores_nothing(machines: tuple[Storage, Storage, str]) -> None:
    first, second, scene = machines
    (folder_of(first, scene) / "growing" / "model").write_text("the frozen worker's")
    stale = lease_of(first, scene, "a")
    (folder_of(second, scene) / "growing" / "model").write_text("the other's")
    WorkingCopies(second).store(lease_of(second, scene, "b"))
    with pytest.raises(StaleLeaseError):
        WorkingCopies(first).store(stale)
    WorkingCopies(first).restore(scene)
    assert (folder_of(first, scene) / "growing" / "model").read_text() == "the other's"


def test_earlier_copies_are_removed_later(machines: tuple[Storage, Storage, str]) -> None:
    first, _, scene = machines
    (folder_of(first, scene) / "growing" / "model").write_text("a model")
    lease = lease_of(first, scene, "a")
    for _ in range(3):
        WorkingCopies(first).store(lease)
    copies = [blob.key for blob in first.blobs.below(f"scenes/{scene}/working/")]
    assert len(copies) == 3
    due = [key for key, _ in _removals(first)]
    assert len(set(copies) - set(due)) == 1


def _removals(storage: Storage) -> list[tuple[str, str]]:
    from fvs_service.storage.tables import RemovalRow
    from sqlalchemy import select

    with storage.database.reading() as session:
        return [(row.key, row.scene_id) for row in session.scalars(select(RemovalRow))]
