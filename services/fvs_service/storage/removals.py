"""Removals: the blobs of deleted resources, recorded in the transaction that deletes their rows.

A deleted resource is gone for every reader at once; its blobs are removed afterwards, by any process, in any
number of tries. A blob that has a row again by then stays.
"""

import time
from collections.abc import Collection, Iterator
from datetime import datetime, timedelta

import structlog
from sqlalchemy import Select, delete, exists, select, tuple_
from sqlalchemy.orm import Session

from fvs_service.errors import StorageRefusedError, StorageUnavailableError
from fvs_service.storage.blob_keys import scene_prefix
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database, lock
from fvs_service.storage.tables import (
    EventRow,
    ImageRow,
    RankingRow,
    RemovalRow,
    SceneRow,
    SnapshotArtifactRow,
    SnapshotRow,
    frames_not_taken,
)

_READ_AT_ONCE = 100
_FIRST_PAUSE_S, _LAST_PAUSE_S = 60.0, 3600.0
"""How long a key that could not be removed is put off; each failure doubles it."""
_TRACES_KEPT = timedelta(days=30)
"""Time for which a scene's deletion is remembered, so that workers that were away remove its folder."""

ABANDONED_AFTER = timedelta(hours=1)
"""When a blob is removed that got no row: its process was killed, or its transaction failed."""
SUBTITLES_KEPT = timedelta(days=7)
"""When the subtitles of a video are removed that never came: slow links take days."""

_log = structlog.get_logger()


def remove_later(session: Session, scene_id: str, key: str, *, after: timedelta = timedelta(0)) -> None:
    """Schedule removing a blob, or all below a key with a final slash; those with a row then stay."""
    lock_scene(session, scene_id)
    start = now()
    row = session.get(RemovalRow, key)
    due = start + after
    if row is None:
        session.add(RemovalRow(key=key, scene_id=scene_id, created_at=start, due_at=due, removed_at=None))
        session.flush()
    else:
        row.created_at, row.due_at, row.removed_at = start, max(due, row.due_at), None


def keep(session: Session, keys: Collection[str]) -> None:
    """Cancel the removal of blobs that have rows now."""
    session.execute(delete(RemovalRow).where(RemovalRow.key.in_(keys)))


class Removals:
    """Removes what is due.

    What was under way when a scene or a ranking was deleted may still write below its prefix: it is emptied
    twice, the second time after ``grace_s``. Later writes have removals of their own (``ABANDONED_AFTER``).
    """

    def __init__(self, database: Database, blobs: Blobs, grace_s: float) -> None:
        self._database = database
        self._blobs = blobs
        self._grace = timedelta(seconds=grace_s)
        self._put_off = _PutOff()

    def run(self) -> int:
        """Remove what is due; returns the number of keys. Several processes may do so at once.

        A key that cannot be removed is put off, and the others do not wait for it. When the object store or
        the database cannot be reached, the rest waits for the next run.
        """
        removed = 0
        failed: dict[str, str] = {}
        for key, scene_id in self._due():
            if self._put_off.waits(key):
                continue
            try:
                self._remove(key, scene_id)
            except (StorageUnavailableError, OSError) as error:
                self._put_off.failed(key)
                failed[key] = str(error)
                if isinstance(error, StorageUnavailableError) and not isinstance(error, StorageRefusedError):
                    break
            else:
                self._put_off.forget(key)
                removed += 1
        if failed:
            key, reason = next(iter(failed.items()))
            _log.warning("removals put off", keys=len(failed), first=key, reason=reason)
        self._forget_traces()
        return removed

    def late(self, by: timedelta) -> tuple[str, ...]:
        """The keys whose removal is overdue by at least ``by``."""
        with self._database.reading() as session:
            return tuple(row.key for row in session.scalars(_due_at(now() - by)))

    def _due(self) -> Iterator[tuple[str, str]]:
        """The keys that are due now with their scenes, the oldest first; none of them twice."""
        due = _due_at(now())
        page = due.limit(_READ_AT_ONCE)
        while True:
            with self._database.reading() as session:
                found = [(row.key, row.scene_id, row.due_at) for row in session.scalars(page)]
            if not found:
                return
            yield from ((key, scene_id) for key, scene_id, _ in found)
            last, _, last_due = found[-1]
            beyond = tuple_(RemovalRow.due_at, RemovalRow.key) > tuple_(last_due, last)
            page = due.where(beyond).limit(_READ_AT_ONCE)

    def _remove(self, key: str, scene_id: str) -> None:
        if key.endswith("/"):
            self._remove_below(key)
        else:
            self._remove_blob(key, scene_id)

    def _remove_below(self, prefix: str) -> None:
        self._blobs.remove_below(prefix)
        with self._database.writing() as session:
            row = session.get(RemovalRow, prefix, with_for_update=True)
            if row is None:
                return
            if now() < row.created_at + self._grace:
                row.due_at = row.created_at + self._grace
            elif prefix == scene_prefix(row.scene_id):
                row.removed_at = now()
            else:
                session.delete(row)

    def _remove_blob(self, key: str, scene_id: str) -> None:
        """Remove one blob in a transaction in which no row can begin to refer to it.

        One at a time: other writers of the scene, on SQLite all, wait for one request to the object store at
        most.
        """
        with self._database.writing(scene_id) as session:
            row = session.get(RemovalRow, key)
            if row is None or row.due_at > now():  # the bytes arrive again, and their removal was put off
                return
            if not has_row(session, key):
                self._blobs.remove(key)
            session.delete(row)

    def _forget_traces(self) -> None:
        old = now() - _TRACES_KEPT
        with self._database.reading() as session:
            scenes = list(session.scalars(select(RemovalRow.scene_id).where(RemovalRow.removed_at < old)))
        if scenes:
            with self._database.writing() as session:
                session.execute(delete(EventRow).where(EventRow.scene_id.in_(scenes)))
                session.execute(
                    delete(RemovalRow).where(RemovalRow.scene_id.in_(scenes), RemovalRow.removed_at < old)
                )


def _due_at(moment: datetime) -> Select[RemovalRow]:
    return (
        select(RemovalRow)
        .where(RemovalRow.removed_at.is_(None), RemovalRow.due_at <= moment)
        .order_by(RemovalRow.due_at, RemovalRow.key)
    )


class _PutOff:
    """The keys that this process could not remove, and when it tries them again."""

    def __init__(self) -> None:
        self._until: dict[str, tuple[float, float]] = {}
        """Key → the last pause, and its end."""

    def waits(self, key: str) -> bool:
        """Whether it is too early to try the key again."""
        _, until = self._until.get(key, (0.0, 0.0))
        return time.monotonic() < until

    def failed(self, key: str) -> None:
        """Put the key off, for twice as long as the last time."""
        last_s, _ = self._until.get(key, (_FIRST_PAUSE_S / 2, 0.0))
        pause_s = min(2 * last_s, _LAST_PAUSE_S)
        self._until[key] = pause_s, time.monotonic() + pause_s

    def forget(self, key: str) -> None:
        """The key was removed."""
        self._until.pop(key, None)


def lock_scene(session: Session, scene_id: str) -> None:
    """Make the transaction of ``session`` the only one that adds or removes blobs of the scene.

    A transaction that references a blob must check within itself that the blob is stored.
    """
    lock(session, scene_id)


def has_row(session: Session, key: str) -> bool:
    """Whether a row refers to the blob ``key``."""
    match key.split("/"):
        case ["scenes", scene_id, "images" | "thumbnails", sha256]:
            found = exists().where(
                ImageRow.scene_id == scene_id, ImageRow.sha256 == sha256, ImageRow.verdict == "accepted"
            )
        case ["scenes", scene_id, "videos" | "subtitles", sha256]:
            found = exists().where(
                ImageRow.scene_id == scene_id, ImageRow.sha256 == sha256, frames_not_taken()
            )
        case ["scenes", scene_id, "masks", digests]:
            image, _, mask = digests.partition("-")
            found = exists().where(
                ImageRow.scene_id == scene_id,
                ImageRow.sha256 == image,
                ImageRow.document["mask"].as_string() == f"sha256:{mask}",
            )
        case ["scenes", scene_id, "artifacts", sha256]:
            found = exists().where(
                SnapshotArtifactRow.scene_id == scene_id, SnapshotArtifactRow.sha256 == sha256
            )
        case ["scenes", scene_id, "snapshots", manifest]:
            snapshot_id = manifest.removesuffix(".json")
            found = exists().where(SnapshotRow.scene_id == scene_id, SnapshotRow.id == snapshot_id)
        case ["scenes", scene_id, "rankings", ranking_id, *_]:
            found = exists().where(RankingRow.scene_id == scene_id, RankingRow.id == ranking_id)
        case ["scenes", scene_id, "working", file]:
            found = exists().where(
                SceneRow.id == scene_id, SceneRow.working_copy == file.removesuffix(".tar")
            )
        case _:
            return False
    return bool(session.scalar(select(found)))


def deleted_scenes(session: Session, scene_ids: list[str]) -> frozenset[str]:
    """Those of ``scene_ids`` that were deleted."""
    prefixes = [scene_prefix(scene_id) for scene_id in scene_ids]
    return frozenset(session.scalars(select(RemovalRow.scene_id).where(RemovalRow.key.in_(prefixes))))
