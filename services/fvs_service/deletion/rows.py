"""Deletion in the database: in one transaction a resource is gone for every reader.

Its blobs are recorded for removal in the same transaction (see ``storage.removals``).
"""

from collections.abc import Iterator
from datetime import timedelta

from sqlalchemy import ColumnElement, delete, select
from sqlalchemy import Table as SqlTable
from sqlalchemy.orm import Session

from fvs_schema.events import EventKind
from fvs_service.events.repository import publish
from fvs_service.storage.blob_keys import artifact_key, manifest_key, ranking_prefix, scene_prefix
from fvs_service.storage.removals import remove_later
from fvs_service.storage.tables import (
    EventRow,
    JobRow,
    PlanRow,
    RankingRow,
    SceneLeaseRow,
    SceneRow,
    SnapshotArtifactRow,
    SnapshotRow,
    Table,
    WebhookRow,
)


def delete_scene(session: Session, scene_id: str) -> None:
    """Delete a scene with everything in it.

    Its lease goes first, so that whatever a worker still writes is refused.
    """
    session.execute(delete(SceneLeaseRow).where(SceneLeaseRow.scene_id == scene_id))
    remove_later(session, scene_id, scene_prefix(scene_id))
    for table, rows in _tables_of(scene_id):
        session.execute(table.delete().where(rows))
    # The others go once they have delivered the last event.
    session.execute(delete(WebhookRow).where(WebhookRow.scene_id == scene_id, WebhookRow.disabled))
    session.execute(delete(EventRow).where(EventRow.scene_id == scene_id))
    session.execute(delete(SceneRow).where(SceneRow.id == scene_id))
    publish(session, scene_id, EventKind.SCENE_DELETED, {})


def delete_snapshot(session: Session, scene_id: str, snapshot_id: str, reason: str, grace: timedelta) -> None:
    """Delete a snapshot; its rankings stay.

    Its blobs are removed after ``grace``, for rankings in computation.
    """
    artifacts = session.scalars(
        select(SnapshotArtifactRow.sha256).where(SnapshotArtifactRow.snapshot_id == snapshot_id)
    ).all()
    remove_later(session, scene_id, manifest_key(scene_id, snapshot_id), after=grace)
    for sha256 in set(artifacts):
        remove_later(session, scene_id, artifact_key(scene_id, sha256), after=grace)
    session.execute(delete(SnapshotArtifactRow).where(SnapshotArtifactRow.snapshot_id == snapshot_id))
    session.execute(delete(SnapshotRow).where(SnapshotRow.id == snapshot_id))
    data = {"snapshot_id": snapshot_id, "reason": reason}
    publish(session, scene_id, EventKind.SNAPSHOT_DELETED, data, subject=snapshot_id)


def delete_ranking(session: Session, scene_id: str, ranking_id: str, reason: str) -> None:
    """Delete a ranking and the renders of its candidates."""
    remove_later(session, scene_id, ranking_prefix(scene_id, ranking_id))
    session.execute(delete(RankingRow).where(RankingRow.id == ranking_id))
    data = {"ranking_id": ranking_id, "reason": reason}
    publish(session, scene_id, EventKind.RANKING_DELETED, data, subject=ranking_id)


def delete_plan(session: Session, scene_id: str, plan_id: str, reason: str) -> None:
    """Delete a plan."""
    session.execute(delete(PlanRow).where(PlanRow.id == plan_id))
    data = {"plan_id": plan_id, "reason": reason}
    publish(session, scene_id, EventKind.PLAN_DELETED, data, subject=plan_id)


def _tables_of(scene_id: str) -> Iterator[tuple[SqlTable, ColumnElement[bool]]]:
    """All tables with rows that belong to a scene or to its jobs, those that refer to others first."""
    jobs = select(JobRow.id).where(JobRow.scene_id == scene_id)
    for table in reversed(Table.metadata.sorted_tables):
        parents = {key.column.table.name: key.parent for key in table.foreign_keys}
        if SceneRow.__tablename__ in parents:
            yield table, parents[SceneRow.__tablename__] == scene_id
        elif JobRow.__tablename__ in parents:
            yield table, parents[JobRow.__tablename__].in_(jobs)
