"""Snapshots in the database."""

from collections.abc import Mapping

from sqlalchemy import and_, func, or_, select, update
from sqlalchemy.orm import Session

from fvs_schema.base import Page
from fvs_schema.jobs import JobKind
from fvs_schema.snapshots import Snapshot, SnapshotList
from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.storage.pages import Cursors, newest_first
from fvs_service.storage.tables import JobRow, SceneRow, SnapshotArtifactRow, SnapshotRow


def add_snapshot(session: Session, snapshot: Snapshot) -> None:
    """Add a snapshot."""
    session.add(
        SnapshotRow(
            id=snapshot.id,
            scene_id=snapshot.scene_id,
            job_id=snapshot.job_id,
            pinned=snapshot.pinned,
            document=snapshot.model_dump(mode="json", exclude={"pinned"}),
            created_at=snapshot.created_at,
        )
    )
    session.flush()
    session.add_all(
        SnapshotArtifactRow(
            snapshot_id=snapshot.id,
            name=artifact.name,
            scene_id=snapshot.scene_id,
            sha256=artifact.sha256,
            size_bytes=artifact.size_bytes,
        )
        for artifact in snapshot.artifacts
    )
    session.flush()


def snapshot_of(session: Session, principal: Principal, snapshot_id: str) -> Snapshot:
    """A snapshot of the principal's tenant; raises ``NotFoundError``."""
    row = session.get(SnapshotRow, snapshot_id)
    scene = None if row is None else session.get(SceneRow, row.scene_id)
    if row is None or scene is None or not principal.owns(scene.tenant_id, scene.id):
        raise NotFoundError("There is no such snapshot.")
    return _snapshot(row)


def find_snapshot(session: Session, snapshot_id: str) -> Snapshot:
    """A snapshot of any tenant, for workers; raises ``NotFoundError``."""
    row = session.get(SnapshotRow, snapshot_id)
    if row is None:
        raise NotFoundError("There is no such snapshot.")
    return _snapshot(row)


def pin(session: Session, snapshot_id: str, *, pinned: bool) -> None:
    """Pin or unpin a snapshot."""
    session.execute(update(SnapshotRow).where(SnapshotRow.id == snapshot_id).values(pinned=pinned))


def with_artifacts(session: Session, scene_id: str, wanted: Mapping[str, str]) -> Snapshot | None:
    """The newest snapshot of a scene with all these artifacts (name → SHA-256); None when none are given."""
    if not wanted:
        return None
    same = or_(
        *(
            and_(SnapshotArtifactRow.name == name, SnapshotArtifactRow.sha256 == sha256)
            for name, sha256 in wanted.items()
        )
    )
    found = (
        select(SnapshotArtifactRow.snapshot_id)
        .where(SnapshotArtifactRow.scene_id == scene_id, same)
        .group_by(SnapshotArtifactRow.snapshot_id)
        .having(func.count() == len(wanted))
    )
    newest_first = select(SnapshotRow).where(SnapshotRow.id.in_(found)).order_by(*SnapshotRow.newest_first())
    row = session.scalar(newest_first.limit(1))
    return None if row is None else _snapshot(row)


def of_update_before(session: Session, scene_id: str, job_id: str) -> str | None:
    """The id of the snapshot of the scene's latest update but ``job_id``; None when there is none."""
    return session.scalar(
        select(JobRow.snapshot_id)
        .where(
            JobRow.scene_id == scene_id,
            JobRow.kind == JobKind.UPDATE.value,
            JobRow.id != job_id,
            JobRow.snapshot_id.is_not(None),
        )
        .order_by(*JobRow.newest_first())
        .limit(1)
    )


def snapshots_of_scene(session: Session, scene_id: str, page: Page) -> SnapshotList:
    """The snapshots of a scene, the newest first; refuses a cursor of another list."""
    query = select(SnapshotRow).where(SnapshotRow.scene_id == scene_id)
    rows, following = newest_first(session, query, SnapshotRow, page, Cursors("snapshots", scene_id))
    return SnapshotList(items=tuple(map(_snapshot, rows)), next=following)


def first_snapshots(session: Session, scene_id: str, count: int) -> tuple[Snapshot, ...]:
    """The oldest snapshots of a scene, in their order."""
    query = select(SnapshotRow).where(SnapshotRow.scene_id == scene_id)
    rows = session.scalars(query.order_by(*SnapshotRow.oldest_first()).limit(count))
    return tuple(map(_snapshot, rows))


def _snapshot(row: SnapshotRow) -> Snapshot:
    return Snapshot.model_validate({**row.document, "pinned": row.pinned})
