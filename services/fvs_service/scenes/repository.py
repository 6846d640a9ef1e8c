"""Scenes in the database."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import Any, TypeAlias
from unicodedata import normalize

from pydantic import TypeAdapter
from sqlalchemy import Row, bindparam, func, null, or_, select, update
from sqlalchemy.orm import Session

from fvs_schema.control_points import ControlPoints
from fvs_schema.jobs import JobKind, JobState
from fvs_schema.scenes import (
    Alignment,
    EnuWorld,
    ImageCounts,
    Origin,
    Scene,
    SceneChange,
    SceneJob,
    SceneList,
    ScenePage,
    SceneRequest,
    SceneSize,
)
from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.storage.database import Reader
from fvs_service.storage.pages import Cursors, newest_first
from fvs_service.storage.tables import (
    ImageRow,
    JobRow,
    SceneRow,
    SnapshotArtifactRow,
    SnapshotRow,
    columns_of,
    frames_not_taken,
)

_ALIGNMENT = TypeAdapter(Alignment)
_SCENES = columns_of(SceneRow)
_HEAD = select(_SCENES.c.id, _SCENES.c.tenant_id, _SCENES.c.origin, _SCENES.c.snapshot_id).where(
    _SCENES.c.id == bindparam("scene_id")
)
"""A statement that is built once, because nearly every request executes it."""
_HeadRow: TypeAlias = Row[str, str, Any, str | None]
_Count: TypeAlias = tuple[str, str, int]
"""A verdict, a registration, and how many images have both."""
_LEFT_OUT = ("excluded", "quarantined")
_NO_SCENE = "There is no such scene."


@dataclass(frozen=True)
class SceneHead:
    """A scene without its images and its model: one row of the database."""

    id: str
    origin: Origin | None
    snapshot_id: str | None


def add_scene(session: Session, scene_id: str, tenant_id: str, request: SceneRequest, at: datetime) -> None:
    """Add a scene."""
    origin = request.world.origin if isinstance(request.world, EnuWorld) else None
    session.add(
        SceneRow(
            id=scene_id,
            tenant_id=tenant_id,
            folded_name=_folded(request.name),
            request=request.model_dump(mode="json"),
            origin=None if origin is None else origin.model_dump(mode="json"),
            snapshot_id=None,
            working_bytes=0,
            last_image_number=0,
            last_deleted_event=0,
            created_at=at,
        )
    )
    session.flush()


def scene_of(session: Session, principal: Principal, scene_id: str) -> Scene:
    """A scene of the principal's tenant; raises ``NotFoundError``."""
    (scene,) = _scenes(session, [_row_of(session, principal, scene_id)])
    return scene


def scene_head_of(reader: Reader, principal: Principal, scene_id: str) -> SceneHead:
    """The head of a scene of the principal's tenant, in a single query; raises ``NotFoundError``."""
    row = _head_row(reader, scene_id)
    if not principal.owns(row.tenant_id, scene_id):
        raise NotFoundError(_NO_SCENE)
    return _head(row)


def find_scene(session: Session, scene_id: str) -> Scene:
    """A scene of any tenant, for workers; raises ``NotFoundError``."""
    (scene,) = _scenes(session, [_row(session, scene_id)])
    return scene


def find_scene_head(reader: Reader, scene_id: str) -> SceneHead:
    """The head of a scene of any tenant, in a single query; raises ``NotFoundError``."""
    return _head(_head_row(reader, scene_id))


def tenant_of(reader: Reader, scene_id: str) -> str:
    """The tenant of a scene, for workers; raises ``NotFoundError``."""
    tenant_id: str = _head_row(reader, scene_id).tenant_id
    return tenant_id


def scenes_of(session: Session, principal: Principal, page: ScenePage) -> SceneList:
    """The scenes of the principal's tenant, or the one of its key; refuses a cursor of another list."""
    query = select(SceneRow).where(SceneRow.tenant_id == principal.tenant_id)
    if principal.scene_id is not None:
        query = query.where(SceneRow.id == principal.scene_id)
    if page.name is not None:
        query = query.where(SceneRow.request["name"].as_string() == page.name)
    if page.search is not None:
        query = query.where(SceneRow.folded_name.contains(_folded(page.search), autoescape=True))
    cursors = Cursors("scenes", principal.tenant_id, page.name or "", page.search or "")
    rows, following = newest_first(session, query, SceneRow, page, cursors)
    return SceneList(items=_scenes(session, rows), next=following)


def count_scenes(session: Session, tenant_id: str) -> int:
    """The number of a tenant's scenes."""
    return session.scalar(select(func.count()).where(SceneRow.tenant_id == tenant_id)) or 0


def change_scene(session: Session, principal: Principal, scene_id: str, change: SceneChange) -> None:
    """Change the settings of a scene of the principal's tenant; raises ``NotFoundError``."""
    row = _row_of(session, principal, scene_id)
    given = change.model_dump(mode="json", exclude_none=True)
    row.request = {**SceneRequest.model_validate(row.request).model_dump(mode="json"), **given}
    row.folded_name = _folded(row.request["name"])
    session.flush()


def size_of(session: Session, scene_id: str) -> SceneSize:
    """The disk space of a scene."""
    original, thumbnail = (ImageRow.document[name].as_integer() for name in ("size_bytes", "thumbnail_bytes"))
    images = session.scalar(
        select(func.sum(original + thumbnail)).where(
            ImageRow.scene_id == scene_id, or_(ImageRow.verdict == "accepted", frames_not_taken())
        )
    )
    blobs = (
        select(SnapshotArtifactRow.sha256, SnapshotArtifactRow.size_bytes)
        .where(SnapshotArtifactRow.scene_id == scene_id)
        .distinct()
        .subquery()
    )
    artifacts = session.scalar(select(func.sum(blobs.c.size_bytes)))
    sizes = int(images or 0), int(artifacts or 0), _row(session, scene_id).working_bytes
    return SceneSize(
        scene_id=scene_id,
        images_bytes=sizes[0],
        artifacts_bytes=sizes[1],
        working_bytes=sizes[2],
        total_bytes=sum(sizes),
    )


def set_working_bytes(session: Session, scene_id: str, size: int) -> None:
    """Record the size of a worker's files of the scene; no effect when it was deleted."""
    session.execute(update(SceneRow).where(SceneRow.id == scene_id).values(working_bytes=size))


def working_copy_of(session: Session, scene_id: str) -> str | None:
    """The name of the newest working copy of a scene's folder; None when there is none."""
    return session.scalar(select(SceneRow.working_copy).where(SceneRow.id == scene_id))


def set_working_copy(session: Session, scene_id: str, name: str) -> None:
    """Record the newest working copy of a scene's folder."""
    session.execute(update(SceneRow).where(SceneRow.id == scene_id).values(working_copy=name))


def set_origin(session: Session, scene_id: str, origin: Origin) -> None:
    """Set the origin of the scene's ENU frame, unless it is set."""
    row = session.get(SceneRow, scene_id)
    if row is not None and row.origin is None:
        row.origin = origin.model_dump(mode="json")
        session.flush()


def control_points_of(session: Session, scene_id: str) -> ControlPoints | None:
    """The control points of a scene; None without any."""
    document = session.scalar(select(SceneRow.control_points).where(SceneRow.id == scene_id))
    return None if document is None else ControlPoints.model_validate(document)


def set_control_points(session: Session, scene_id: str, points: ControlPoints | None) -> None:
    """Set the control points of a scene; None removes them."""
    document = null() if points is None else points.model_dump(mode="json")
    session.execute(update(SceneRow).where(SceneRow.id == scene_id).values(control_points=document))


def set_snapshot(session: Session, scene_id: str, snapshot_id: str) -> None:
    """Set the scene's latest snapshot."""
    row = session.get(SceneRow, scene_id)
    if row is not None:
        row.snapshot_id = snapshot_id
        session.flush()


def _row_of(session: Session, principal: Principal, scene_id: str) -> SceneRow:
    row = _row(session, scene_id)
    if not principal.owns(row.tenant_id, scene_id):
        raise NotFoundError(_NO_SCENE)
    return row


def _row(session: Session, scene_id: str) -> SceneRow:
    row = session.get(SceneRow, scene_id)
    if row is None:
        raise NotFoundError(_NO_SCENE)
    return row


def _head_row(reader: Reader, scene_id: str) -> _HeadRow:
    row = reader.execute(_HEAD, {"scene_id": scene_id}).one_or_none()
    if row is None:
        raise NotFoundError(_NO_SCENE)
    return row


def _head(row: _HeadRow) -> SceneHead:
    return SceneHead(row.id, _origin(row.origin), row.snapshot_id)


def _origin(document: Any) -> Origin | None:
    return None if document is None else Origin.model_validate(document)


def _folded(name: str) -> str:
    """A name without the differences that a search ignores: of case, and of how letters are composed."""
    return normalize("NFKC", normalize("NFKC", name).casefold())


def _scenes(session: Session, rows: Sequence[SceneRow]) -> tuple[Scene, ...]:
    """The domain models of rows, with as many queries as for one."""
    ids = [row.id for row in rows]
    counts, jobs = _counts(session, ids), _jobs(session, ids)
    snapshots = _snapshots(session, [row.snapshot_id for row in rows if row.snapshot_id is not None])
    return tuple(
        _scene(row, counts.get(row.id, ()), snapshots.get(row.snapshot_id or ""), jobs.get(row.id))
        for row in rows
    )


def _scene(
    row: SceneRow,
    counts: Sequence[_Count],
    snapshot: tuple[Alignment, datetime] | None,
    job: SceneJob | None,
) -> Scene:
    request = SceneRequest.model_validate(row.request)
    alignment, snapshot_created_at = snapshot or (None, None)
    scene = Scene(
        id=row.id,
        name=request.name,
        world=request.world,
        origin=_origin(row.origin),
        camera=request.camera,
        policy=request.policy,
        retention=request.retention,
        image_counts=_image_counts(counts),
        snapshot_id=row.snapshot_id,
        snapshot_created_at=snapshot_created_at,
        alignment=alignment,
        job=job,
        created_at=row.created_at,
        etag="",
    )
    content = scene.model_dump_json(exclude={"etag"})
    return scene.model_copy(update={"etag": hashlib.sha256(content.encode()).hexdigest()[:32]})


def _snapshots(session: Session, ids: Sequence[str]) -> dict[str, tuple[Alignment, datetime]]:
    """The alignments of snapshots and when they were made, by id."""
    if not ids:
        return {}
    rows = session.execute(
        select(SnapshotRow.id, SnapshotRow.document["alignment"], SnapshotRow.created_at).where(
            SnapshotRow.id.in_(ids)
        )
    )
    return {snapshot_id: (_ALIGNMENT.validate_python(alignment), at) for snapshot_id, alignment, at in rows}


def _jobs(session: Session, scene_ids: Sequence[str]) -> dict[str, SceneJob]:
    """What is done with scenes, or is next."""
    running = JobState.RUNNING.value
    rows = session.execute(
        select(JobRow.scene_id, JobRow.id, JobRow.kind, JobRow.state)
        .where(JobRow.state.in_([JobState.QUEUED.value, running]), JobRow.scene_id.in_(scene_ids))
        .order_by(JobRow.state != running, *JobRow.oldest_first())
    )
    found: dict[str, SceneJob] = {}
    for scene_id, job_id, kind, state in rows:
        found.setdefault(scene_id, SceneJob(id=job_id, kind=JobKind(kind), state=JobState(state)))
    return found


def _counts(session: Session, scene_ids: Sequence[str]) -> dict[str, list[_Count]]:
    """The numbers of images of scenes by verdict and registration."""
    rows = session.execute(
        select(ImageRow.scene_id, ImageRow.verdict, ImageRow.registration, func.count())
        .where(ImageRow.scene_id.in_(scene_ids))
        .group_by(ImageRow.scene_id, ImageRow.verdict, ImageRow.registration)
    )
    found: dict[str, list[_Count]] = {}
    for scene_id, verdict, registration, count in rows:
        found.setdefault(scene_id, []).append((verdict, registration, count))
    return found


def _image_counts(counts: Sequence[_Count]) -> ImageCounts:
    received = sum(count for verdict, _, count in counts if verdict != "video")
    accepted = sum(count for verdict, _, count in counts if verdict == "accepted")
    of = {state: sum(n for _, found, n in counts if found == state) for state in ("pending", *_LEFT_OUT)}
    return ImageCounts(received=received, accepted=accepted, rejected=received - accepted, **of)
