"""Jobs."""

from fvs_client.models.base import Answer, Input, ReprArgs, Timestamp, Word


class JobKind(Word):
    """What a job does."""

    UPDATE = "update"
    """Registers all pending images and trains the model anew."""
    FINE = "fine"
    """Trains the final model from the latest cameras."""


class JobState(Word):
    """State of a job."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"


_ENDED = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELED})


class JobRequest(Input):
    """Settings of a new job."""

    kind: JobKind
    iterations: int | None = None
    """Training iterations of the full model of an update, or of the fine model; the default depends on the
    kind of job and the number of images. Of a scene's updates only the first can set it: later ones have no
    fewer, and with more images as many per image."""
    long_side_px: int | None = None
    """Reduce training images to this long side. Of a scene's updates only the first can set it."""
    test_every: int | None = None
    """Fine jobs only: hold out every Nth image and measure the model on it."""


class JobFailure(Answer):
    """Why a job failed."""

    code: str
    message: str
    hint: str
    retryable: bool
    stage: str | None


class WaitReason(Word):
    """Why a job does not run now."""

    QUEUE = "queue"
    """Other jobs go first."""
    SCENE = "scene"
    """Another job of the scene goes first."""
    TENANT_LIMIT = "tenant-limit"
    """The tenant's limit of running jobs is reached."""
    MEMORY = "memory"
    """The workers' memory is in use."""
    DISK = "disk"
    """The service's disk is full; the job continues when there is room."""
    NO_WORKER = "no-worker"
    """No worker is alive."""


class JobWaiting(Answer):
    """Why a job does not run now, and when it may."""

    place: int
    """Its position in the queue of all waiting jobs; the first is 1."""
    reason: WaitReason
    message: str
    eta_s: float | None
    """Estimated time until its turn."""


class JobData(Answer):
    """A job and its progress."""

    id: str
    scene_id: str
    kind: JobKind
    state: JobState
    stage: str | None
    progress: float
    """Progress of the whole job, in [0, 1]; never decreases within an attempt."""
    eta_s: float | None
    """An estimate of the time that it still has to run."""
    waiting: JobWaiting | None = None
    """Why it does not run now: it is queued, or pauses for others."""
    attempt: int
    cancel_requested: bool
    warnings: tuple[str, ...]
    error: JobFailure | None
    snapshot_id: str | None
    """The latest snapshot of the job."""
    created_at: Timestamp
    started_at: Timestamp | None
    finished_at: Timestamp | None

    @property
    def ended(self) -> bool:
        """Whether the job has succeeded, failed or been canceled."""
        return self.state in _ENDED

    def __repr_args__(self) -> ReprArgs:
        yield from (("id", self.id), ("scene_id", self.scene_id), ("kind", self.kind.value))
        yield from (("state", self.state.value), ("progress", self.progress))
        yield "snapshot_id", self.snapshot_id
