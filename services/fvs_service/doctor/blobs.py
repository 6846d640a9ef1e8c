"""Blobs without rows, rows without blobs, and removals that were not done."""

from collections.abc import Iterator
from datetime import datetime, timedelta

from sqlalchemy import select, update

from fvs_service.application import Storage
from fvs_service.deletion import rows
from fvs_service.doctor.finding import Finding
from fvs_service.storage.blob_keys import artifact_key, image_key, manifest_key
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.removals import has_row
from fvs_service.storage.tables import (
    ImageRow,
    RemovalRow,
    SceneRow,
    SnapshotArtifactRow,
    SnapshotRow,
)

_REPAIRED = "repaired"
"""The reason of a deletion in its event."""


def blobs_without_rows(storage: Storage, before: datetime) -> Iterator[Finding]:
    """Blobs that no row refers to and no removal knows; newer ones may belong to a commit in progress."""
    for blob in storage.blobs.below("scenes/"):
        if blob.modified_at < before and _is_unknown(storage, blob.key):
            yield Finding(
                "blob without row",
                blob.key,
                f"remove {blob.size_bytes} bytes",
                lambda key=blob.key: _remove(storage, key),  # type: ignore[misc]
            )


def unfinished_blobs(blobs: Blobs, before: datetime) -> Iterator[Finding]:
    """Files of writes that a crash interrupted."""
    for file in blobs.unfinished(before):
        yield Finding(
            "unfinished write",
            file.name,
            "remove it",
            lambda file=file: file.unlink(missing_ok=True),  # type: ignore[misc]
        )


def late_removals(storage: Storage, by: timedelta) -> Iterator[Finding]:
    """Blobs of deleted resources that should have been removed long ago: no worker runs, or it fails."""
    for key in storage.removals.late(by):
        yield Finding("half deletion", key, "remove the blobs", storage.removals.run)


def images_without_blobs(storage: Storage) -> Iterator[Finding]:
    """Images whose bytes are lost; without their rows the same files can be sent again."""
    with storage.database.reading() as session:
        query = select(ImageRow.scene_id, ImageRow.sha256, ImageRow.name).where(
            ImageRow.verdict == "accepted"
        )
        images = session.execute(query).all()
    for scene_id, sha256, name in images:
        key = image_key(scene_id, sha256)
        if not storage.blobs.exists(key) and _is_still_there(storage, key):
            yield Finding(
                "image without blob",
                f"{scene_id} sha256:{sha256} ({name})",
                "forget it, so that it can be sent again",
                lambda scene_id=scene_id, sha256=sha256: _forget_image(storage, scene_id, sha256),  # type: ignore[misc]
            )


def snapshots_without_blobs(storage: Storage) -> Iterator[Finding]:
    """Snapshots of which an artifact is lost."""
    for scene_id, snapshot_id in _broken_snapshots(storage):
        yield Finding(
            "snapshot without blob",
            snapshot_id,
            "delete it; the newest whole one becomes the scene's",
            lambda scene_id=scene_id, snapshot_id=snapshot_id: _drop_snapshot(storage, scene_id, snapshot_id),  # type: ignore[misc]
        )


def _is_still_there(storage: Storage, key: str) -> bool:
    """Whether a row refers to the blob; it may have been deleted since it was read."""
    with storage.database.reading() as session:
        return has_row(session, key)


def _is_unknown(storage: Storage, key: str) -> bool:
    with storage.database.reading() as session:
        if has_row(session, key):
            return False
        parts = key.split("/")
        prefixes = ["/".join(parts[:number]) + "/" for number in range(2, len(parts))]
        known = select(RemovalRow.key).where(
            RemovalRow.key.in_([key, *prefixes]), RemovalRow.removed_at.is_(None)
        )
        return session.scalar(known.limit(1)) is None


def _remove(storage: Storage, key: str) -> None:
    with storage.database.writing(key.split("/")[1]) as session:
        if not has_row(session, key):  # it may have got one since
            storage.blobs.remove(key)


def _forget_image(storage: Storage, scene_id: str, sha256: str) -> None:
    with storage.database.writing(scene_id) as session:
        row = session.get(ImageRow, (scene_id, sha256))
        if row is not None and not storage.blobs.exists(image_key(scene_id, sha256)):
            session.delete(row)


def _broken_snapshots(storage: Storage) -> list[tuple[str, str]]:
    with storage.database.reading() as session:
        found = session.execute(
            select(SnapshotArtifactRow.scene_id, SnapshotArtifactRow.snapshot_id, SnapshotArtifactRow.sha256)
        ).all()
    broken = {
        (scene_id, snapshot_id)
        for scene_id, snapshot_id, sha256 in found
        if not storage.blobs.exists(artifact_key(scene_id, sha256))
    }
    listed = {(scene_id, snapshot_id) for scene_id, snapshot_id, _ in found}
    broken |= {pair for pair in listed if not storage.blobs.exists(manifest_key(*pair))}
    return sorted(pair for pair in broken if _is_still_there(storage, manifest_key(*pair)))


def _drop_snapshot(storage: Storage, scene_id: str, snapshot_id: str) -> None:
    broken = {name for _, name in _broken_snapshots(storage)}
    if snapshot_id not in broken:
        return
    with storage.database.writing(scene_id) as session:
        whole = session.scalars(
            select(SnapshotRow.id)
            .where(SnapshotRow.scene_id == scene_id)
            .order_by(*SnapshotRow.newest_first())
        )
        newest = next((name for name in whole if name not in broken), None)
        session.execute(
            update(SceneRow)
            .where(SceneRow.id == scene_id, SceneRow.snapshot_id == snapshot_id)
            .values(snapshot_id=newest)
        )
        if session.get(SnapshotRow, snapshot_id) is not None:
            rows.delete_snapshot(session, scene_id, snapshot_id, _REPAIRED, timedelta(0))
