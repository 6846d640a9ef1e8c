"""The queue of jobs: their rows in the database, from which workers take them in the fair order.

A job belongs to the worker in its row until that worker puts it back; a worker that is restarted resumes it.
When workers take a job at the same time, one changes the row, and the others look again.
"""

from collections.abc import Collection, Iterable

from sqlalchemy import ColumnElement, delete, func, select, update
from sqlalchemy.exc import IntegrityError
from sqlalchemy.orm import Session

from fvs_schema.jobs import JobKind, JobState, WaitReason
from fvs_service.jobs.order import OpenJob, Order
from fvs_service.jobs.repository import OPEN
from fvs_service.jobs.states import Move, Mover, Turn, move
from fvs_service.storage.clock import now_ms
from fvs_service.storage.database import Database
from fvs_service.storage.notifications import Topic, announce
from fvs_service.storage.tables import JobRow, TenantRow, WorkerRow

_TRY_AGAIN_MS = 5_000
_PLACED_MS = 30_000
"""A job that waits for a place on a node is also woken when it has one."""
_LOOKS = 8
"""Number of lost races for a job in a row after which a worker leaves the queue to the others."""


class JobQueue:
    """The queue of all jobs; safe to use from any thread."""

    def __init__(self, database: Database, *, jobs_per_tenant: int, turn_s: float) -> None:
        self._database = database
        self._jobs_per_tenant = jobs_per_tenant
        self._turn_s = turn_s

    def take(self, worker_id: str) -> Turn | None:
        """Take the job that is next; None when none can have a turn."""
        for _ in range(_LOOKS):
            with self._database.reading() as session:
                if not _anything_waits(session):
                    return None
            try:
                with self._database.writing("queue") as session:
                    chosen = self.order(session).next
                    if chosen is None:
                        return None
                    taken = take_job(session, chosen.id, worker_id) if _serve(session, chosen) else None
            except IntegrityError:  # another worker took another job of the scene, or of a new tenant
                continue
            if taken is not None:
                return taken
        return None

    def taken_by(self, worker_id: str) -> tuple[Turn, ...]:
        """The turns that a worker has begun and that have not ended."""
        query = select(JobRow).where(JobRow.worker_id == worker_id, JobRow.state.in_(OPEN))
        with self._database.reading() as session:
            return tuple(map(_turn, session.scalars(query)))

    def put_back(self, turn: Turn, obstacle: WaitReason | None = None) -> None:
        """End a turn: the job waits for its next one, unless it has ended; ``obstacle`` is what it lacked."""
        with self._database.writing() as session:
            move(session, Move.PUT_BACK, Mover.WORKER, *_is_of(turn), **_lacks(obstacle))

    def keep_workers(self, worker_ids: Collection[str]) -> int:
        """End the turns of all workers but these, which no longer exist, and forget them.

        Returns the number of turns.
        """
        others = JobRow.worker_id.not_in(worker_ids)
        with self._database.writing() as session:
            ended = move(session, Move.PUT_BACK, Mover.SUPERVISOR, others, **_lacks(None))
            session.execute(delete(WorkerRow).where(WorkerRow.id.not_in(worker_ids)))
        return len(ended)

    def try_again(self, scene_id: str) -> None:
        """Let the waiting jobs of a scene have a turn at once: what they lacked is there."""
        waits = (JobRow.scene_id == scene_id, JobRow.state.in_(OPEN), JobRow.worker_id.is_(None))
        with self._database.writing() as session:
            session.execute(update(JobRow).where(*waits).values(**_lacks(None)))
            announce(session, Topic.JOBS)

    def has_open(self, scene_id: str) -> bool:
        """Whether a job of the scene waits or runs."""
        query = select(JobRow.id).where(JobRow.scene_id == scene_id, JobRow.state.in_(OPEN)).limit(1)
        with self._database.reading() as session:
            return session.scalar(query) is not None

    def has(self, turn: Turn) -> bool:
        """Whether the turn has not ended."""
        with self._database.reading() as session:
            query = select(JobRow.id).where(*_is_of(turn), JobRow.state.in_(OPEN))
            return session.scalar(query) is not None

    def must_pause(self, job_id: str, *, turn_may_end: bool) -> bool:
        """Whether a job in a turn is to make room for another one, at once or because its turn is over."""
        with self._database.reading() as session:
            if not _anything_waits(session):
                return False
            order = self.order(session)
        return any(
            order.update_of_scene_waits(job) or (turn_may_end and order.turn_ends(job))
            for job in order.running
            if job.id == job_id
        )

    def update_waits(self, scene_id: str) -> bool:
        """Whether an update of the scene is queued."""
        waiting = select(JobRow.id).where(
            JobRow.scene_id == scene_id,
            JobRow.kind == JobKind.UPDATE.value,
            JobRow.state == JobState.QUEUED.value,
        )
        with self._database.reading() as session:
            return session.scalar(waiting.limit(1)) is not None

    def order(self, session: Session) -> Order:
        """The order of all open jobs."""
        served = (
            select(JobRow.scene_id, func.max(JobRow.taken_at_ms).label("served_ms"))
            .where(JobRow.scene_id.in_(select(JobRow.scene_id).where(JobRow.state.in_(OPEN))))
            .group_by(JobRow.scene_id)
            .subquery()
        )
        rows = session.execute(
            select(
                JobRow.id,
                JobRow.tenant_id,
                JobRow.scene_id,
                JobRow.kind,
                JobRow.waiting_since_ms,
                served.c.served_ms,
                JobRow.worker_id,
                JobRow.taken_at_ms,
                (JobRow.state == JobState.RUNNING.value).label("begun"),
                JobRow.cancel_requested,
                JobRow.obstacle,
                JobRow.not_before_ms,
            )
            .join(served, served.c.scene_id == JobRow.scene_id)
            .where(JobRow.state.in_(OPEN))
        )
        jobs = tuple(
            OpenJob(
                **{
                    **row._asdict(),
                    "kind": JobKind(row.kind),
                    "obstacle": None if row.obstacle is None else WaitReason(row.obstacle),
                }
            )
            for row in rows
        )
        tenants = _served(session, {job.tenant_id for job in jobs})
        return Order(
            jobs=jobs,
            tenants_served_ms=tenants,
            limit=self._jobs_per_tenant,
            turn_ms=round(1000 * self._turn_s),
            now_ms=session.scalar(select(now_ms())) or 0,
        )


def take_job(session: Session, job_id: str, worker_id: str) -> Turn | None:
    """Begin a job's turn on a worker; None when another worker has it, or it has ended."""
    taken = move(session, Move.TAKE, Mover.WORKER, JobRow.id == job_id, worker_id=worker_id, obstacle=None)
    return _turn(taken[0]) if taken else None


def _anything_waits(session: Session) -> bool:
    query = select(JobRow.id).where(JobRow.state.in_(OPEN), JobRow.worker_id.is_(None))
    return session.scalar(query.limit(1)) is not None


def _serve(session: Session, job: OpenJob) -> bool:
    """Record that the tenant gets a turn now; False when another worker has just given it one."""
    row = session.get(TenantRow, job.tenant_id)
    if row is None:
        session.add(TenantRow(id=job.tenant_id, served_at_ms=now_ms()))
        return True
    changed = session.scalar(
        update(TenantRow)
        .where(TenantRow.id == job.tenant_id, TenantRow.served_at_ms == row.served_at_ms)
        .values(served_at_ms=now_ms())
        .returning(TenantRow.id)
        .execution_options(synchronize_session=False)
    )
    return changed is not None


def _served(session: Session, tenants: Iterable[str]) -> dict[str, int]:
    rows = session.scalars(select(TenantRow).where(TenantRow.id.in_(list(tenants))))
    return {row.id: row.served_at_ms for row in rows}


def _lacks(obstacle: WaitReason | None) -> dict[str, object]:
    """The columns of a job that lacked this in its turn."""
    if obstacle is None:
        return {"obstacle": None, "not_before_ms": 0}
    placed = obstacle in (WaitReason.GPU, WaitReason.NODE, WaitReason.NO_NODE)
    again_ms = _PLACED_MS if placed else _TRY_AGAIN_MS
    return {"obstacle": obstacle.value, "not_before_ms": now_ms() + again_ms}


def _is_of(turn: Turn) -> tuple[ColumnElement[bool], ...]:
    """The conditions that a job's row is in this turn."""
    return JobRow.id == turn.job_id, JobRow.attempt == turn.attempt, JobRow.worker_id == turn.worker_id


def _turn(row: JobRow) -> Turn:
    assert row.worker_id is not None
    return Turn(row.id, row.scene_id, JobKind(row.kind), row.attempt, row.worker_id, row.traceparent)
