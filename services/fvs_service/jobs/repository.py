"""Jobs in the database."""

from typing import Any

from sqlalchemy import func, select, update
from sqlalchemy.orm import Session

from fvs_schema.jobs import Job, JobFailure, JobKind, JobList, JobPage, JobRequest, JobState
from fvs_schema.stages import Stage
from fvs_service.errors import NotFoundError
from fvs_service.jobs.stages import Work
from fvs_service.principal import Principal
from fvs_service.storage.pages import Cursors, newest_first
from fvs_service.storage.tables import ImageRow, JobMilestoneRow, JobRow, frames_not_taken

OPEN = (JobState.QUEUED.value, JobState.RUNNING.value)
"""The states of jobs that have not ended, as they are stored."""


def job_of(session: Session, principal: Principal, job_id: str) -> Job:
    """A job of the principal's tenant; raises ``NotFoundError``."""
    row = session.get(JobRow, job_id)
    if row is None or not principal.owns(row.tenant_id, row.scene_id):
        raise NotFoundError("There is no such job.")
    return to_job(row)


def needs_of(session: Session, job_id: str) -> Work:
    """What a job needs next; raises ``NotFoundError``."""
    row = session.get(JobRow, job_id)
    if row is None:
        raise NotFoundError("There is no such job.")
    return Work(row.work)


def find_job(session: Session, job_id: str) -> Job:
    """A job of any tenant, for workers; raises ``NotFoundError``."""
    row = session.get(JobRow, job_id, populate_existing=True)
    if row is None:
        raise NotFoundError("There is no such job.")
    return to_job(row)


def jobs_of_scene(session: Session, scene_id: str, page: JobPage) -> JobList:
    """The jobs of a scene, the newest first; refuses a cursor of another list."""
    states = sorted({state.value for state in page.state})
    query = select(JobRow).where(JobRow.scene_id == scene_id)
    if states:
        query = query.where(JobRow.state.in_(states))
    rows, following = newest_first(session, query, JobRow, page, Cursors("jobs", scene_id, *states))
    return JobList(items=tuple(map(to_job, rows)), next=following)


def queued_job(session: Session, scene_id: str, kind: JobKind) -> Job | None:
    """The scene's queued job of this kind, of which there is at most one."""
    row = session.scalar(
        select(JobRow).where(
            JobRow.scene_id == scene_id, JobRow.kind == kind.value, JobRow.state == JobState.QUEUED.value
        )
    )
    return None if row is None else to_job(row)


def first_update(session: Session, scene_id: str) -> Job | None:
    """The scene's first update that succeeded, which set how its model is trained."""
    row = session.scalar(
        select(JobRow)
        .where(
            JobRow.scene_id == scene_id,
            JobRow.kind == JobKind.UPDATE.value,
            JobRow.state == JobState.SUCCEEDED.value,
        )
        .order_by(*JobRow.oldest_first())
        .limit(1)
    )
    return None if row is None else to_job(row)


def unprocessed_images(session: Session, scene_id: str) -> int:
    """The number of accepted images that no update, finished or running, processes."""
    running = session.scalar(
        select(JobRow).where(
            JobRow.scene_id == scene_id,
            JobRow.kind == JobKind.UPDATE.value,
            JobRow.state == JobState.RUNNING.value,
        )
    )
    taken = None if running is None else last_image_number(session, running.id, running.attempt)
    query = select(func.count()).where(
        ImageRow.scene_id == scene_id,
        ImageRow.registration == "pending",
        ImageRow.number > (taken or 0),
    )
    return session.scalar(query) or 0


def waiting_videos(session: Session, scene_id: str) -> int:
    """The number of the scene's videos whose frames are still to be taken."""
    query = select(func.count()).where(ImageRow.scene_id == scene_id, frames_not_taken())
    return session.scalar(query) or 0


def last_image_number(session: Session, job_id: str, attempt: int) -> int | None:
    """The number of the last image that an attempt processes; None before its first start."""
    taken = session.get(JobMilestoneRow, (job_id, images_milestone(attempt)))
    return None if taken is None else int(taken.document["last_number"])


def images_milestone(attempt: int) -> str:
    """The name of the milestone with the ``last_number`` of the images that an attempt processes."""
    return f"images-{attempt}"


def open_jobs(session: Session, tenant_id: str) -> int:
    """The number of a tenant's queued and running jobs."""
    query = select(func.count()).where(JobRow.tenant_id == tenant_id, JobRow.state.in_(OPEN))
    return session.scalar(query) or 0


def change_running(session: Session, job_id: str, **values: Any) -> Job | None:
    """Change what is known of a running job, but not its state (``states``); None when it does not run."""
    row = session.scalar(
        update(JobRow)
        .where(JobRow.id == job_id, JobRow.state == JobState.RUNNING.value)
        .values(**values)
        .returning(JobRow)
        .execution_options(populate_existing=True)
    )
    return None if row is None else to_job(row)


def to_job(row: JobRow) -> Job:
    """The domain model of a row."""
    return Job(
        id=row.id,
        scene_id=row.scene_id,
        kind=JobKind(row.kind),
        request=JobRequest.model_validate(row.request),
        state=JobState(row.state),
        stage=None if row.stage is None else Stage(row.stage),
        progress=row.progress,
        eta_s=row.eta_s,
        attempt=row.attempt,
        cancel_requested=row.cancel_requested,
        warnings=tuple(row.warnings),
        error=None if row.error is None else JobFailure.model_validate(row.error),
        snapshot_id=row.snapshot_id,
        created_at=row.created_at,
        started_at=row.started_at,
        finished_at=row.finished_at,
    )
