"""Snapshots in the database."""

from sqlalchemy import select
from sqlalchemy.orm import Session

from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.snapshots.model import Snapshot
from fvs_service.storage.tables import SceneRow, SnapshotRow


def add_snapshot(session: Session, snapshot: Snapshot) -> None:
    """Add a snapshot."""
    session.add(
        SnapshotRow(
            id=snapshot.id,
            scene_id=snapshot.scene_id,
            job_id=snapshot.job_id,
            document=snapshot.model_dump(mode="json"),
            created_at=snapshot.created_at,
        )
    )
    session.flush()


def snapshot_of(session: Session, principal: Principal, snapshot_id: str) -> Snapshot:
    """A snapshot of the principal's tenant; raises ``NotFoundError``."""
    row = session.get(SnapshotRow, snapshot_id)
    scene = None if row is None else session.get(SceneRow, row.scene_id)
    if row is None or scene is None or not principal.owns(scene.tenant_id, scene.id):
        raise NotFoundError("There is no such snapshot.")
    return Snapshot.model_validate(row.document)


def find_snapshot(session: Session, snapshot_id: str) -> Snapshot:
    """A snapshot of any tenant, for workers; raises ``NotFoundError``."""
    row = session.get(SnapshotRow, snapshot_id)
    if row is None:
        raise NotFoundError("There is no such snapshot.")
    return Snapshot.model_validate(row.document)


def snapshots_of_scene(
    session: Session, scene_id: str, after: str | None, limit: int
) -> tuple[Snapshot, ...]:
    """The snapshots of a scene, the oldest first."""
    rows = session.scalars(
        select(SnapshotRow)
        .where(SnapshotRow.scene_id == scene_id, SnapshotRow.id > (after or ""))
        .order_by(SnapshotRow.id)
        .limit(limit)
    )
    return tuple(Snapshot.model_validate(row.document) for row in rows)
