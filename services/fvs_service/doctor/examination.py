"""The examination: everything the doctor looks for, in order; safe while the service runs."""

import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path

from sqlalchemy import or_, select, update

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.lock import locked_folder
from fvs_schema.images import Verdict
from fvs_service.application import Storage
from fvs_service.deletion import rows
from fvs_service.images.files import blob_key
from fvs_service.settings import Settings
from fvs_service.storage.blob_keys import artifact_key, manifest_key
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from fvs_service.storage.removals import has_row
from fvs_service.storage.tables import (
    ImageRow,
    RemovalRow,
    SceneRow,
    SnapshotArtifactRow,
    SnapshotRow,
    frames_not_taken,
)

_REPAIRED = "repaired"
"""The reason of a deletion in its event."""


@dataclass(frozen=True)
class Finding:
    """Something that should not be there, or is missing; ``repair`` ends that, and may be called twice."""

    kind: str
    what: str
    """The blob, row, file or folder."""
    remedy: str
    """The effect of ``repair``."""
    repair: Callable[[], object]


def examine(storage: Storage, grace: timedelta) -> Iterator[Finding]:
    """What is wrong; files and blobs younger than ``grace`` may belong to something in progress."""
    before = now() - grace
    yield from late_removals(storage, grace)
    yield from blobs_without_rows(storage, before)
    yield from unfinished_blobs(storage.blobs, before)
    yield from images_without_blobs(storage)
    yield from snapshots_without_blobs(storage)
    yield from folders_of_no_scene(storage, before)
    yield from abandoned_uploads(storage.settings, before)


def examine_without_database(settings: Settings, grace: timedelta) -> Iterator[Finding]:
    """Findings about this machine's disk that need no database."""
    before = now() - grace
    if settings.blobs.url is None:
        yield from unfinished_blobs(Blobs(settings.blobs_folder), before)
    yield from abandoned_uploads(settings, before)


def blobs_without_rows(storage: Storage, before: datetime) -> Iterator[Finding]:
    """Blobs that no row refers to and no removal knows; newer ones may belong to a commit in progress."""
    for blob in storage.blobs.below("scenes/"):
        if blob.modified_at < before and _is_unknown(storage, blob.key):
            yield Finding(
                "blob without row",
                blob.key,
                f"remove {blob.size_bytes} bytes",
                lambda key=blob.key: _remove_blob(storage, key),  # type: ignore[misc]
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
    """Images and waiting videos whose bytes are lost; without their rows the files can be sent again."""
    with storage.database.reading() as session:
        query = select(ImageRow.scene_id, ImageRow.sha256, ImageRow.name, ImageRow.verdict).where(
            or_(ImageRow.verdict == "accepted", frames_not_taken())
        )
        images = session.execute(query).all()
    for scene_id, sha256, name, verdict in images:
        key = blob_key(scene_id, sha256, Verdict(verdict))
        if not storage.blobs.exists(key) and _is_still_there(storage, key):
            yield Finding(
                "image without blob",
                f"{scene_id} sha256:{sha256} ({name})",
                "forget it, so that it can be sent again",
                lambda scene_id=scene_id, sha256=sha256, key=key: _forget_image(
                    storage, scene_id, sha256, key
                ),  # type: ignore[misc]
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


def folders_of_no_scene(storage: Storage, before: datetime) -> Iterator[Finding]:
    """Working folders on this machine whose scene does not exist."""
    folder = storage.settings.scenes
    names = {found.name for found in folder.iterdir()} if folder.is_dir() else set()
    with storage.database.reading() as session:
        names -= set(session.scalars(select(SceneRow.id)))
    for name in sorted(names):
        if _is_older(folder / name, before):
            yield Finding(
                "working folder of no scene",
                str(folder / name),
                "remove it",
                lambda path=folder / name: _remove_folder(path),  # type: ignore[misc]
            )


def abandoned_uploads(settings: Settings, before: datetime) -> Iterator[Finding]:
    """Files of uploads that cannot be continued, and that nothing has been written to for a while."""
    for file in sorted(settings.uploads.glob("*.part")):
        if _is_older(file, before):
            yield Finding(
                "abandoned upload",
                str(file),
                "remove it",
                lambda file=file: file.unlink(missing_ok=True),  # type: ignore[misc]
            )


def _is_older(path: Path, before: datetime) -> bool:
    try:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC) < before
    except FileNotFoundError:
        return False


def _remove_folder(folder: Path) -> None:
    try:
        with locked_folder(folder):
            shutil.rmtree(folder, ignore_errors=True)
    except (OutputExistsError, StorageError):  # a runner uses it, and ends with its scene; or it is gone
        return


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


def _remove_blob(storage: Storage, key: str) -> None:
    with storage.database.writing(key.split("/")[1]) as session:
        if not has_row(session, key):  # it may have got one since
            storage.blobs.remove(key)


def _forget_image(storage: Storage, scene_id: str, sha256: str, key: str) -> None:
    with storage.database.writing(scene_id) as session:
        row = session.get(ImageRow, (scene_id, sha256))
        if row is not None and not storage.blobs.exists(key):
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
