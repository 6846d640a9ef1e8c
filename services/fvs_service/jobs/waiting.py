"""Why jobs that are not in a turn wait, and for how long: derived from the queue and the workers."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from statistics import median

from sqlalchemy import select
from sqlalchemy.orm import Session

from fvs_schema.jobs import Job, JobKind, JobState, JobWaiting, WaitReason
from fvs_service.jobs.fleet import is_alive
from fvs_service.jobs.order import OpenJob, Order, Place
from fvs_service.jobs.queue import JobQueue
from fvs_service.storage.tables import JobRow, WorkerRow

_RECENT = 20
"""Number of recent finished jobs used to estimate a job's duration."""

_MESSAGES = {
    WaitReason.SCENE: "Another job of the scene goes first; updates go before fine models.",
    WaitReason.TENANT_LIMIT: "The limit of your running jobs is reached.",
    WaitReason.MEMORY: "The workers' memory is in use.",
    WaitReason.DISK: "The service's disk is full; the job continues when there is room.",
    WaitReason.NO_WORKER: "No worker is alive.",
    WaitReason.CLUSTER: "The Ray cluster cannot be reached, or its nodes cannot run the service: see the "
    "log of `fvs serve --role worker`.",
    WaitReason.NODE: "The CPUs or the memory of all nodes of the cluster are in use.",
    WaitReason.GPU: "All GPUs of the cluster are in use.",
    WaitReason.NO_NODE: "No node of the cluster has the CPUs, GPUs and memory that the job needs: wait for "
    "an autoscaler, add one, or lower FVS_WORKER__THREADS, FVS_WORKER__GPUS or the size of images.",
}
_BEFORE = {0: "It is the next one.", 1: "1 job goes first."}


@dataclass(frozen=True)
class Workers:
    """The live workers: the jobs that they run at once, and those of them whose disk is not full."""

    alive: int
    slots: int
    slots_with_room: int


def with_waiting(session: Session, queue: JobQueue, jobs: Sequence[Job]) -> tuple[Job, ...]:
    """The jobs; those that wait have the reason."""
    if all(job.state.ended for job in jobs):
        return tuple(jobs)
    order = queue.order(session)
    places = {place.job.id: place for place in order.line}
    workers = _workers(session)
    usual_s = {kind: _usual_s(session, kind) for kind in JobKind}
    return tuple(
        job
        if (place := places.get(job.id)) is None
        else job.model_copy(update={"waiting": why_it_waits(place, order, workers, usual_s)})
        for job in jobs
    )


def why_it_waits(
    place: Place, order: Order, workers: Workers, usual_s: Mapping[JobKind, float | None]
) -> JobWaiting:
    """Why the job at this position waits; ``usual_s`` is the usual duration of a job by kind."""
    if workers.slots == 0:  # a worker without slots waits for its cluster
        reason = WaitReason.CLUSTER if workers.alive else WaitReason.NO_WORKER
        message = _MESSAGES[reason]
    elif (obstacle := place.obstacle or place.job.obstacle) is not None:  # the job's: in its last turn
        reason, message = obstacle, _MESSAGES[obstacle]
    elif workers.slots_with_room == 0:
        reason, message = WaitReason.DISK, _MESSAGES[WaitReason.DISK]
    else:
        reason, message = (
            WaitReason.QUEUE,
            _BEFORE.get(place.number - 1, f"{place.number - 1} jobs go first."),
        )
    return JobWaiting(
        place=place.number, reason=reason, message=message, eta_s=_eta_s(place, order, workers, usual_s)
    )


def _eta_s(
    place: Place, order: Order, workers: Workers, usual_s: Mapping[JobKind, float | None]
) -> float | None:
    """The time until the turn: jobs that run now or go first take at most a turn each, on all workers."""
    obstacle = place.obstacle or place.job.obstacle
    if workers.slots_with_room == 0 or obstacle in (WaitReason.CLUSTER, WaitReason.NO_NODE):
        return None
    turn_s = order.turn_ms / 1000
    total_s = 0.0
    for job in (*order.running, *(before.job for before in order.line[: place.number - 1])):
        usual = usual_s[job.kind]
        if usual is None:
            return None
        ran_s = (order.now_ms - job.taken_at_ms) / 1000 if job.worker_id is not None else 0.0
        makes_room = job.tenant_id != place.job.tenant_id or _is_fine_before_update(job, place.job)
        total_s += max(0.0, (min(usual, turn_s) if makes_room else usual) - ran_s)
    return total_s / workers.slots_with_room


def _is_fine_before_update(job: OpenJob, other: OpenJob) -> bool:
    return job.kind is JobKind.FINE and other.kind is JobKind.UPDATE


def _workers(session: Session) -> Workers:
    alive = session.scalars(select(WorkerRow).where(is_alive())).all()
    return Workers(
        alive=len(alive),
        slots=sum(worker.slots for worker in alive),
        slots_with_room=sum(worker.slots for worker in alive if not worker.disk_full),
    )


def _usual_s(session: Session, kind: JobKind) -> float | None:
    """The median time of the latest jobs that succeeded; None before the first."""
    rows = session.execute(
        select(JobRow.started_at, JobRow.finished_at)
        .where(JobRow.kind == kind.value, JobRow.state == JobState.SUCCEEDED.value)
        .order_by(*JobRow.newest_first())
        .limit(_RECENT)
    )
    took = [
        (row.finished_at - row.started_at).total_seconds()
        for row in rows
        if row.started_at is not None and row.finished_at is not None
    ]
    return median(took) if took else None
