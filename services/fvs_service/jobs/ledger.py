"""The ledger of jobs: the workers' reads and writes. Every write is fenced by the scene's lease."""

import time
from collections.abc import Mapping
from typing import Any

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from fvs_schema.events import EventKind
from fvs_schema.findings import Notice
from fvs_schema.jobs import Job, JobFailure
from fvs_schema.stages import Stage
from fvs_service.events.repository import publish
from fvs_service.jobs import repository
from fvs_service.jobs.stages import Work
from fvs_service.jobs.states import Move, Mover, move
from fvs_service.scenes.lease import Lease, require_lease
from fvs_service.storage.clock import now, now_ms
from fvs_service.storage.database import Database
from fvs_service.storage.tables import JobMilestoneRow, JobRow

_REPORT_EVERY_S = 0.4
"""A little less than the time between two reports of a runner."""


class Ledger:
    """The ledger of one worker process; after a ``StaleLeaseError`` from a write the job must stop."""

    def __init__(self, database: Database) -> None:
        self._database = database
        self._reported: dict[str, tuple[Stage | None, float]] = {}

    def start(self, lease: Lease, job_id: str, attempt: int) -> Job | None:
        """Start an attempt, also again after a crash; None when the job has ended."""
        with self._database.writing() as session:
            require_lease(session, lease)
            attempted = (JobRow.id == job_id, JobRow.attempt == attempt)
            started = move(
                session, Move.START, Mover.WORKER, *attempted, worker_id=lease.worker_id, started_at=now()
            ) or move(
                session,
                Move.START_AGAIN,
                Mover.WORKER,
                *attempted,
                taken_at_ms=now_ms(),  # the start of the runner is no part of the turn
            )
            return repository.to_job(started[0]) if started else None

    def report(
        self, lease: Lease, job_id: str, stage: Stage, progress: float, eta_s: float | None = None
    ) -> None:
        """Record the job's progress, in [0, 1], which never decreases; too frequent reports are dropped."""
        last_stage, last_time = self._reported.get(job_id, (None, 0.0))
        if stage == last_stage and time.monotonic() - last_time < _REPORT_EVERY_S:
            return
        self._reported[job_id] = (stage, time.monotonic())
        with self._database.writing() as session:
            require_lease(session, lease)
            before = repository.find_job(session, job_id)
            reached = max(before.progress, min(1.0, progress))
            job = repository.change_running(session, job_id, stage=stage, progress=reached, eta_s=eta_s)
            if job is not None:
                data = {
                    "job_id": job_id,
                    "kind": job.kind,
                    "attempt": job.attempt,
                    "stage": stage,
                    "progress": reached,
                    "eta_s": eta_s,
                }
                publish(session, lease.scene_id, EventKind.JOB_PROGRESS, data, subject=job_id)

    def warn(self, lease: Lease, job_id: str, warning: Notice) -> None:
        """Add a warning, unless it was added before."""
        with self._database.writing() as session:
            require_lease(session, lease)
            add_warning(session, job_id, warning)

    def cancel_requested(self, job_id: str) -> bool:
        """Whether the job is to be canceled or was deleted; cheap enough for several calls a second."""
        with self._database.reading() as session:
            wanted = session.scalar(select(JobRow.cancel_requested).where(JobRow.id == job_id))
        return wanted is None or wanted

    def milestone(self, job_id: str, name: str) -> Mapping[str, Any] | None:
        """The document of a milestone; None when the job has not come to it."""
        with self._database.reading() as session:
            row = session.get(JobMilestoneRow, (job_id, name))
            return None if row is None else row.document

    def commit_milestone(self, lease: Lease, job_id: str, name: str, document: Mapping[str, Any]) -> None:
        """Record a milestone: what led to it is not done again. Its files must be on disk."""
        with self._database.writing() as session:
            require_lease(session, lease)
            record_milestone(session, job_id, name, document)

    def needs(self, lease: Lease, job_id: str, work: Work) -> None:
        """Record what a running job needs next."""
        with self._database.writing() as session:
            require_lease(session, lease)
            repository.change_running(session, job_id, work=work.value)

    def succeed(self, lease: Lease, job_id: str) -> None:
        """Record the job as succeeded."""
        self._end(lease, job_id, Move.SUCCEED, progress=1.0)

    def fail(self, lease: Lease, job_id: str, error: JobFailure) -> None:
        """Record the job as failed."""
        self._end(lease, job_id, Move.FAIL, error=error.model_dump(mode="json"))

    def cancel(self, lease: Lease, job_id: str) -> None:
        """Record the job as canceled."""
        self._end(lease, job_id, Move.CANCEL)

    def _end(self, lease: Lease, job_id: str, how: Move, **values: Any) -> None:
        """End a job; without effect when it has ended before: the step ran twice."""
        with self._database.writing() as session:
            require_lease(session, lease)
            move(session, how, Mover.WORKER, JobRow.id == job_id, **values)
        self._reported.pop(job_id, None)


def record_milestone(session: Session, job_id: str, name: str, document: Mapping[str, Any]) -> None:
    """Record a milestone in the transaction of ``session``; the first record stays."""
    if session.get(JobMilestoneRow, (job_id, name)) is None:
        session.add(JobMilestoneRow(job_id=job_id, name=name, document=dict(document), created_at=now()))


def add_warning(session: Session, job_id: str, warning: Notice) -> None:
    """Add a warning to a running job, unless it was added before."""
    warnings = repository.find_job(session, job_id).warnings
    if warning not in warnings:
        documents = [known.model_dump(mode="json") for known in (*warnings, warning)]
        repository.change_running(session, job_id, warnings=documents)


def attach_snapshot(session: Session, job_id: str, snapshot_id: str) -> None:
    """Set the job's latest snapshot."""
    session.execute(update(JobRow).where(JobRow.id == job_id).values(snapshot_id=snapshot_id))
