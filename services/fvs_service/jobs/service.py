"""The operations on jobs."""

from sqlalchemy.orm import Session

from fvs_schema.jobs import Job, JobKind, JobList, JobPage, JobRequest, JobState
from fvs_schema.scenes import Scene, Trigger
from fvs_schema.service import Limits
from fvs_service.errors import ConflictError, LimitExceededError, UnfinishedJobError
from fvs_service.ids import new_id
from fvs_service.jobs import repository
from fvs_service.jobs.queue import JobQueue
from fvs_service.jobs.states import Move, Mover, move, retry, submit
from fvs_service.jobs.waiting import with_waiting
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.repository import scene_of
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database, lock
from fvs_service.storage.idempotency import IdempotencyKey
from fvs_service.storage.tables import JobRow


class Jobs:
    """Queues, returns, cancels and retries jobs; their rows are the queue."""

    def __init__(self, database: Database, queue: JobQueue, limits: Limits) -> None:
        self._database = database
        self._queue = queue
        self._limits = limits

    def create(self, principal: Principal, scene_id: str, request: JobRequest, key: str | None = None) -> Job:
        """Queue a job, or return the one of the same kind that is queued.

        Raises ``ConflictError`` when the queued one, or the scene's first update, has other settings.
        """
        principal.require(Scope.OPERATE, scene_id)
        remembered = IdempotencyKey(principal.tenant_id, key, f"jobs.create {scene_id}", request)
        with self._database.writing(principal.tenant_id, scene_id) as session:
            scene = scene_of(session, principal, scene_id)
            known = remembered.resource(session, lambda job: repository.job_of(session, principal, job))
            if known is not None:
                return self._with_waiting(session, known)
            if request.kind is JobKind.FINE and scene.snapshot_id is None:
                raise ConflictError(
                    "A fine model needs the cameras of an update, and the scene has had none.",
                    hint='Run an update first (fvs-client update, a job {"kind": "update"}).',
                )
            if request.kind is JobKind.FRAMES and not repository.waiting_videos(session, scene_id):
                raise ConflictError(
                    "The scene has no video whose frames are still to be taken.",
                    hint="Upload a video: that queues the job.",
                )
            if request.kind is JobKind.UPDATE:
                _require_settings_of(repository.first_update(session, scene_id), request)
            job = self._add(session, principal.tenant_id, scene, request)
            remembered.remember(session, job.id)
            return self._with_waiting(session, job)

    def get(self, principal: Principal, job_id: str) -> Job:
        """One job; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return self._with_waiting(session, repository.job_of(session, principal, job_id))

    def of_scene(self, principal: Principal, scene_id: str, page: JobPage) -> JobList:
        """The jobs of a scene, the newest first; refuses a cursor of another list."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_of(session, principal, scene_id)
            found = repository.jobs_of_scene(session, scene_id, page)
            return JobList(items=with_waiting(session, self._queue, found.items), next=found.next)

    def cancel(self, principal: Principal, job_id: str) -> Job:
        """Cancel a job: at once while it waits, at its next step while it runs."""
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            job = repository.job_of(session, principal, job_id)
            stopped = move(session, Move.CANCEL, Mover.CLIENT, JobRow.id == job_id)
            if stopped:
                return repository.to_job(stopped[0])
            return repository.change_running(session, job_id, cancel_requested=True) or job

    def retry(self, principal: Principal, job_id: str) -> Job:
        """Queue a failed or canceled job again; its finished stages are not repeated.

        Raises ``ConflictError`` in another state, ``UnfinishedJobError`` while another job waits to do the
        same, ``LimitExceededError`` as ``create`` does.
        """
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            lock(session, principal.tenant_id, repository.job_of(session, principal, job_id).scene_id)
            job = repository.job_of(session, principal, job_id)
            if job.state not in (JobState.FAILED, JobState.CANCELED):
                raise ConflictError(
                    f"The job is {job.state.value}; only failed and canceled jobs can be retried.",
                    hint="Submit another job." if job.state.ended else "Cancel it first to begin again.",
                )
            if repository.queued_job(session, job.scene_id, job.kind) is not None:
                raise UnfinishedJobError(
                    f"Another {job.kind.value} job of the scene is queued, and does the same.",
                    hint="Try again if that job has ended and did not succeed.",
                )
            self._require_room(session, principal.tenant_id)
            return self._with_waiting(session, retry(session, job) or job)

    def take_frames(self, session: Session, tenant_id: str, scene: Scene) -> None:
        """Queue the job that takes the frames of the scene's videos; in the transaction that adds one."""
        self._add(session, tenant_id, scene, JobRequest(kind=JobKind.FRAMES), limited=False)

    def update_if_due(self, session: Session, tenant_id: str, scene: Scene) -> None:
        """Queue an update if the scene's policy requires one for its images.

        Called in the transaction that adds an image.
        """
        policy, counts = scene.policy, scene.image_counts
        if policy.trigger is Trigger.ON_REQUEST or counts.usable < policy.first:
            return
        due = 1 if policy.trigger is Trigger.EACH_IMAGE or scene.snapshot_id is None else policy.k
        if counts.pending >= due and repository.unprocessed_images(session, scene.id) >= due:
            self._add(session, tenant_id, scene, JobRequest(kind=JobKind.UPDATE), limited=False)

    def _require_room(self, session: Session, tenant_id: str) -> None:
        """Raise ``LimitExceededError`` unless the tenant may have another open job."""
        if repository.open_jobs(session, tenant_id) >= self._limits.open_jobs_per_tenant:
            raise LimitExceededError(
                f"{self._limits.open_jobs_per_tenant} jobs are queued or running; no more are allowed.",
                hint="Wait for one to end, or cancel one.",
                retry_after_s=30,
            )

    def _with_waiting(self, session: Session, job: Job) -> Job:
        return with_waiting(session, self._queue, (job,))[0]

    def _add(
        self, session: Session, tenant_id: str, scene: Scene, request: JobRequest, *, limited: bool = True
    ) -> Job:
        queued = repository.queued_job(session, scene.id, request.kind)
        if queued is not None:
            if limited and queued.request != request:
                settings = queued.request.model_dump_json(exclude_none=True)
                raise ConflictError(
                    f"{queued.id} is queued with other settings.",
                    hint=f"Cancel it first, or use its settings: {settings}.",
                )
            return queued
        if limited:
            self._require_room(session, tenant_id)
        return submit(session, new_id("job"), scene.id, tenant_id, request, now())


def _require_settings_of(first: Job | None, request: JobRequest) -> None:
    """Raise ``ConflictError`` when an update has other settings than the scene's first update."""
    for name in ("iterations", "long_side_px"):
        wanted = getattr(request, name)
        if first is None or wanted is None or wanted == getattr(first.request, name):
            continue
        kept = getattr(first.request, name)
        raise ConflictError(
            f"The scene's first update set {name} to {'the default' if kept is None else kept}, "
            "and the model keeps it.",
            hint=f"Omit {name}. Fine jobs and new scenes can have other values.",
        )
