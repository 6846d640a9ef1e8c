"""The states of a job, the moves between them, and who may make each. Nothing else changes a job's state.

A *job* is what a client asked for. An *attempt* at it begins when it is submitted or retried, and ends when
the job succeeds, fails or is canceled; attempts are numbered from 1. A *turn* is the time for which a worker
has the job: an attempt may need several, because other jobs have turns in between.

              submit: client
                    │
              ┌─────▼─────┐   cancel: client, at once
    ┌────────▶│  queued   ├──────────────────────────┐
    │         └─────┬─────┘                          │
    │               │ start: worker                  │
    │         ┌─────▼─────┐   cancel: worker,        │
    │         │  running  ├──────────────────────────┤
    │         └─┬───────┬─┘   or client while it     │
    │           │       │     waits for a turn       │
    │   succeed:│       │fail:                       │
    │   worker  │       │worker                      │
    │   ┌───────▼───┐ ┌─▼────────┐           ┌───────▼────┐
    │   │ succeeded │ │  failed  │           │  canceled  │
    │   └───────────┘ └─┬────────┘           └───────┬────┘
    └───────────────────┴────────────────────────────┘
                          retry: client, attempt + 1

After a process has died, a worker starts a running job again: it stays running.

While it is queued or running, it waits for a turn or is in one:

    waits ── take: worker ──▶ in a turn ── put back: worker, or supervisor ──▶ waits

A worker starts and ends a job by the lease of its scene, whose token fences each of these moves (``Ledger``).
"""

from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from enum import Enum
from typing import Any, NamedTuple

import structlog
from sqlalchemy import ColumnElement, and_, or_, update
from sqlalchemy.orm import Session

from fvs_schema.events import EventKind
from fvs_schema.jobs import Job, JobKind, JobRequest, JobState
from fvs_service.events.repository import delete_progress, publish
from fvs_service.jobs.repository import to_job
from fvs_service.jobs.stages import first_work
from fvs_service.storage.clock import now, now_ms
from fvs_service.storage.commit_hooks import after_commit
from fvs_service.storage.notifications import Topic, announce
from fvs_service.storage.tables import JobRow
from fvs_service.tracing import traceparent

_log = structlog.get_logger()


@dataclass(frozen=True)
class Turn:
    """A turn of an attempt on a worker; everything else is read from the job's row when it starts."""

    job_id: str
    scene_id: str
    kind: JobKind
    attempt: int
    worker_id: str
    traceparent: str | None = None
    """The span of the request that queued it."""

    @property
    def attempt_id(self) -> str:
        """The id of the attempt."""
        return f"{self.job_id}.{self.attempt}"


class Mover(Enum):
    """Who moves jobs: clients, the worker that has them, and the supervisor of the workers."""

    CLIENT = "client"
    WORKER = "worker"
    SUPERVISOR = "supervisor"
    """For a worker that no longer exists."""


class Status(NamedTuple):
    """A job's state, and whether it is in a turn."""

    state: JobState
    in_turn: bool


_QUEUED = frozenset({Status(JobState.QUEUED, False), Status(JobState.QUEUED, True)})
_RUNNING = frozenset({Status(JobState.RUNNING, False), Status(JobState.RUNNING, True)})
_OPEN = _QUEUED | _RUNNING
_WAITS = frozenset(status for status in _OPEN if not status.in_turn)
_IN_TURN = _OPEN - _WAITS
_REPEATABLE = frozenset({Status(JobState.FAILED, False), Status(JobState.CANCELED, False)})


@dataclass(frozen=True)
class _Rule:
    """Who may make a move from where, where it leads to (None: stays the same), and the event about it."""

    sources: Mapping[Mover, frozenset[Status]]
    state: JobState | None
    in_turn: bool | None
    event: EventKind | None = None


class Move(Enum):
    """What changes a job's state, or its turn."""

    TAKE = _Rule({Mover.WORKER: _WAITS}, None, True)
    PUT_BACK = _Rule({Mover.WORKER: _IN_TURN, Mover.SUPERVISOR: _IN_TURN}, None, False)
    START = _Rule({Mover.WORKER: _QUEUED}, JobState.RUNNING, True, EventKind.JOB_STARTED)
    START_AGAIN = _Rule({Mover.WORKER: _RUNNING}, JobState.RUNNING, None)
    SUCCEED = _Rule({Mover.WORKER: _RUNNING}, JobState.SUCCEEDED, False, EventKind.JOB_SUCCEEDED)
    FAIL = _Rule({Mover.WORKER: _RUNNING}, JobState.FAILED, False, EventKind.JOB_FAILED)
    CANCEL = _Rule(
        {Mover.CLIENT: _QUEUED | _WAITS, Mover.WORKER: _RUNNING},
        JobState.CANCELED,
        False,
        EventKind.JOB_CANCELED,
    )
    RETRY = _Rule({Mover.CLIENT: _REPEATABLE}, JobState.QUEUED, False, EventKind.JOB_QUEUED)


def move(
    session: Session, how: Move, by: Mover, *which: ColumnElement[bool], **values: Any
) -> tuple[JobRow, ...]:
    """Make a move with the jobs for which ``which`` holds and ``by`` may make it; returns those.

    ``values`` go into their other columns; ``worker_id`` is among them when a turn begins.
    """
    rule = how.value
    values = {**_columns_after(rule), **values}
    rows = session.scalars(
        update(JobRow)
        .where(or_(*map(_is, rule.sources[by])), *which)
        .values(**values)
        .returning(JobRow)
        .execution_options(populate_existing=True)
    ).all()
    if rows and rule.in_turn is False:
        announce(session, Topic.JOBS)  # it waits again, or another one may have its place
    for row in rows:
        if rule.event is not None:
            _report(session, row, rule.event)
    return tuple(rows)


def submit(
    session: Session, job_id: str, scene_id: str, tenant_id: str, request: JobRequest, at: datetime
) -> Job:
    """Add a job, queued."""
    row = JobRow(
        id=job_id,
        scene_id=scene_id,
        tenant_id=tenant_id,
        kind=request.kind.value,
        request=request.model_dump(mode="json"),
        stage=None,
        attempt=1,
        warnings=[],
        snapshot_id=None,
        created_at=at,
        **_new_attempt(request.kind),
        **_columns_after(Move.RETRY.value),
    )
    session.add(row)
    session.flush()
    announce(session, Topic.JOBS)
    _report(session, row, EventKind.JOB_QUEUED)
    return to_job(row)


def retry(session: Session, job: Job) -> Job | None:
    """Begin another attempt at a failed or canceled job; None when it is in another state."""
    rows = move(
        session,
        Move.RETRY,
        Mover.CLIENT,
        JobRow.id == job.id,
        attempt=JobRow.attempt + 1,
        **_new_attempt(job.kind),
    )
    return to_job(rows[0]) if rows else None


def _new_attempt(kind: JobKind) -> dict[str, Any]:
    """The columns of an attempt that begins, with what earlier ones left."""
    return {
        "progress": 0.0,
        "eta_s": None,
        "taken_at_ms": 0,
        "obstacle": None,
        "not_before_ms": 0,
        "work": first_work(kind).value,
        "starts": None,
        "traceparent": traceparent(),
        "cancel_requested": False,
        "error": None,
        "started_at": None,
        "finished_at": None,
    }


def _columns_after(rule: _Rule) -> dict[str, Any]:
    """The columns that every job has after a move by this rule."""
    values: dict[str, Any] = {}
    if rule.in_turn is not None:
        values |= {"taken_at_ms": now_ms()} if rule.in_turn else {"worker_id": None}
    if rule.in_turn is False:
        values["waiting_since_ms"] = now_ms()
    if rule.state is not None:
        values["state"] = rule.state.value
        if rule.state.ended:
            values |= {"eta_s": None, "finished_at": now(), "cancel_requested": False}
    return values


def _is(status: Status) -> ColumnElement[bool]:
    """The condition that a job has this status."""
    worker = JobRow.worker_id
    return and_(
        JobRow.state == status.state.value, worker.is_not(None) if status.in_turn else worker.is_(None)
    )


def _report(session: Session, row: JobRow, kind: EventKind) -> None:
    """Publish the event about a move, and log that a job waits or has ended."""
    job = to_job(row)
    about = {"job": job.id, "scene": job.scene_id, "kind": job.kind.value, "attempt": job.attempt}
    data: dict[str, Any] = {"job_id": job.id, "kind": job.kind.value, "attempt": job.attempt}
    if job.state is JobState.QUEUED:
        after_commit(session, lambda: _log.info("job queued", **about))  # with the id of the request
    elif job.state.ended:
        data |= {"error": row.error, "snapshot_id": job.snapshot_id, "warnings": row.warnings}
        delete_progress(session, job.id)
        ran_s = None
        if job.started_at is not None and job.finished_at is not None:
            ran_s = round((job.finished_at - job.started_at).total_seconds(), 3)
        end = {"state": job.state.value, "seconds": ran_s, "error": job.error and job.error.code}
        after_commit(session, lambda: _log.info("job ended", **about, **end))
    publish(session, job.scene_id, kind, data)
