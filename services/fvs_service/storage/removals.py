"""Removals: the blobs of deleted resources, recorded in the transaction that deletes their rows.

A deleted resource is gone for every reader at once; its blobs are removed afterwards, by any process, in any
number of tries. A blob that has a row again by then stays.
"""

from collections.abc import Collection
from datetime import datetime, timedelta

from sqlalchemy import Select, delete, exists, select
from sqlalchemy.orm import Session

from fvs_service.model import now
from fvs_service.storage.blob_keys import scene_prefix
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database, lock
from fvs_service.storage.tables import (
    EventRow,
    ImageRow,
    RankingRow,
    RemovalRow,
    SceneRow,
    SnapshotArtifactRow,
    SnapshotRow,
)

_AT_ONCE = 100
"""Blobs of one scene that are removed in one transaction."""
_TRACES_KEPT = timedelta(days=30)
"""Time for which a scene's deletion is remembered, so that workers that were away remove its folder."""


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

    Uploads and rankings that were under way when their scene or ranking was deleted may still write below its
    prefix: it is emptied twice, the second time after ``grace_s``.
    """

    def __init__(self, database: Database, blobs: Blobs, grace_s: float) -> None:
        self._database = database
        self._blobs = blobs
        self._grace = timedelta(seconds=grace_s)

    def run(self) -> int:
        """Remove all that is due; returns the number of keys. Several processes may do so at once."""
        done = 0
        while due := self._due():
            done += len(due)
            for key, _ in due:
                if key.endswith("/"):
                    self._remove_below(key)
            for scene_id in dict.fromkeys(scene_id for _, scene_id in due):
                self._remove_blobs(scene_id, [key for key, scene in due if scene == scene_id])
        self._forget_traces()
        return done

    def late(self, by: timedelta) -> tuple[str, ...]:
        """The keys whose removal is overdue by at least ``by``."""
        with self._database.reading() as session:
            return tuple(row.key for row in session.scalars(_due_at(now() - by)))

    def _due(self) -> list[tuple[str, str]]:
        with self._database.reading() as session:
            return [(row.key, row.scene_id) for row in session.scalars(_due_at(now()).limit(_AT_ONCE))]

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

    def _remove_blobs(self, scene_id: str, keys: list[str]) -> None:
        """Remove single blobs in a transaction in which no row can begin to refer to them."""
        single = [key for key in keys if not key.endswith("/")]
        if not single:
            return
        with self._database.writing(scene_id) as session:
            for key in single:
                if not has_row(session, key):
                    self._blobs.remove(key)
            session.execute(delete(RemovalRow).where(RemovalRow.key.in_(single)))

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
        .order_by(RemovalRow.due_at)
    )


def lock_scene(session: Session, scene_id: str) -> None:
    """Make the transaction of ``session`` the only one that adds or removes blobs of the scene.

    A transaction that references a blob must check within itself that the blob is stored.
    """
    lock(session, scene_id)


def has_row(session: Session, key: str) -> bool:
    """Whether a row refers to the blob ``key``."""
    match key.split("/"):
        case ["scenes", scene_id, "images", sha256]:
            found = exists().where(ImageRow.scene_id == scene_id, ImageRow.sha256 == sha256)
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
