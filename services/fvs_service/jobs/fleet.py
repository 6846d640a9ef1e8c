"""The fleet in the database: live workers, and waiting and running jobs."""

from collections.abc import Mapping

from sqlalchemy import ColumnElement, func, select
from sqlalchemy.orm import Session

from fvs_schema.jobs import JobState
from fvs_schema.service import WorkerStatus
from fvs_service.jobs.repository import OPEN
from fvs_service.storage.clock import now_ms
from fvs_service.storage.tables import JobRow, SceneLeaseRow, WorkerRow

HEARTBEAT_S = 4.0
"""How often a worker sends a heartbeat."""
_SILENT_S = 3 * HEARTBEAT_S
"""A worker without a heartbeat for this long is reported as not alive, and nothing is expected of it.
It keeps its jobs: its supervisor restarts it."""


def is_alive() -> ColumnElement[bool]:
    """The condition on a worker's row that the worker is alive."""
    return WorkerRow.beaten_at_ms >= now_ms() - round(1000 * _SILENT_S)


def workers_of(session: Session) -> tuple[WorkerStatus, ...]:
    """List all workers by id."""
    leases = (
        select(SceneLeaseRow.worker_id, func.count().label("runners"))
        .where(SceneLeaseRow.endpoint.is_not(None), SceneLeaseRow.expires_at_ms > now_ms())
        .group_by(SceneLeaseRow.worker_id)
        .subquery()
    )
    rows = session.execute(
        select(WorkerRow, func.coalesce(leases.c.runners, 0), is_alive(), now_ms())
        .outerjoin(leases, leases.c.worker_id == WorkerRow.id)
        .order_by(WorkerRow.id)
    )
    found = []
    for row, runners, alive, now in rows:
        found.append(
            WorkerStatus(
                id=row.id,
                alive=alive,
                heartbeat_age_s=max(0.0, (now - row.beaten_at_ms) / 1000),
                backend=row.backend,
                slots=row.slots,
                disk_full=row.disk_full,
                runners=runners,
                runner_bytes=row.runner_bytes,
            )
        )
    return tuple(found)


def open_jobs(session: Session) -> Mapping[tuple[str, str, str], int]:
    """The numbers of queued and running jobs by kind, state and stage ("" before the first)."""
    stage = func.coalesce(JobRow.stage, "")
    rows = session.execute(
        select(JobRow.kind, JobRow.state, stage, func.count())
        .where(JobRow.state.in_(OPEN))
        .group_by(JobRow.kind, JobRow.state, stage)
    )
    return {(kind, state, of_stage): count for kind, state, of_stage, count in rows}


def longest_wait_s(session: Session) -> float:
    """How long the oldest queued job has waited; 0 without one."""
    waited_ms = session.scalar(
        select(now_ms() - func.min(JobRow.recorded_at_ms)).where(JobRow.state == JobState.QUEUED.value)
    )
    return max(0.0, (waited_ms or 0) / 1000)
