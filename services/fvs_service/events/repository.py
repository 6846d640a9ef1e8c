"""Events in the database, written in the transaction of the change that they report."""

from collections.abc import Mapping
from typing import Any

from sqlalchemy import delete, func, insert, select, text
from sqlalchemy.orm import Session

from fvs_schema.events import Event, EventKind
from fvs_service.storage.clock import now
from fvs_service.storage.commit_hooks import before_commit
from fvs_service.storage.database import lock
from fvs_service.storage.notifications import Topic, announce
from fvs_service.storage.tables import EventRow, SceneRow, columns_of

_PUBLISHED = "fvs_published"
_MOST_LOST = 10_000
"""More events than are published between two transactions that are durable."""
_SKIP = text("UPDATE sqlite_sequence SET seq = seq + :skipped WHERE name = :events")


def publish(
    session: Session, scene_id: str, kind: EventKind, data: Mapping[str, Any], *, subject: str | None = None
) -> None:
    """Add an event; it is streamed once the transaction of ``session`` is committed.

    It gets its number at the very end, one transaction after the other: a reader that has seen an event has
    seen every earlier one.
    """
    announce(session, Topic.EVENTS)
    if _PUBLISHED not in session.info:
        session.info[_PUBLISHED] = []
        before_commit(session, _number)
    session.info[_PUBLISHED].append(
        {
            "scene_id": scene_id,
            "kind": kind.value,
            "subject": subject,
            "data": dict(data),
            "created_at": now(),
        }
    )


def _number(session: Session) -> None:
    session.flush()
    lock(session, "events")  # the last lock of every transaction
    session.execute(insert(columns_of(EventRow)), session.info.pop(_PUBLISHED))


def events_after(session: Session, scene_id: str, number: int, limit: int = 256) -> tuple[Event, ...]:
    """The events of a scene after ``number``, the oldest first.

    Where the retention has deleted some of them, or a backup of before ``number`` was restored, the first one
    reports the gap.
    """
    last_deleted = session.scalar(select(SceneRow.last_deleted_event).where(SceneRow.id == scene_id)) or 0
    if number < last_deleted:
        gap = _gap(scene_id, last_deleted, "retention")
        return (gap, *events_after(session, scene_id, last_deleted, limit))
    newest = last_number(session)
    if number > newest:
        return (_gap(scene_id, newest, "restored backup"),)
    rows = session.scalars(
        select(EventRow)
        .where(EventRow.scene_id == scene_id, EventRow.number > number)
        .order_by(EventRow.number)
        .limit(limit)
    )
    return tuple(
        Event(
            number=row.number,
            scene_id=row.scene_id,
            kind=EventKind(row.kind),
            data=row.data,
            created_at=row.created_at,
        )
        for row in rows
    )


def _gap(scene_id: str, number: int, reason: str) -> Event:
    """Report that the events up to ``number`` are not known as the client has seen them."""
    data = {"reason": reason}
    return Event(number=number, scene_id=scene_id, kind=EventKind.EVENTS_DELETED, data=data, created_at=now())


def last_number(session: Session) -> int:
    """The number of the newest event of all scenes, 0 before the first."""
    return session.scalar(select(func.max(EventRow.number))) or 0


def skip_lost_numbers(session: Session) -> None:
    """Skip the numbers of events that a power cut may have undone: a client may have seen them already.

    To be called when a service starts. PostgreSQL never gives a number twice, and loses none.
    """
    if session.get_bind().dialect.name == "sqlite":
        session.execute(_SKIP, {"events": EventRow.__tablename__, "skipped": _MOST_LOST})


def delete_progress(session: Session, job_id: str) -> None:
    """Delete the progress events of a job that has ended: streams never resume between them."""
    session.execute(
        delete(EventRow).where(EventRow.subject == job_id, EventRow.kind == EventKind.JOB_PROGRESS.value)
    )
