"""Jobs."""

from fvs_client.models.base import Answer, Input, Timestamp, Word


class JobKind(Word):
    """What a job does."""

    UPDATE = "update"
    """Registers all pending images and trains the model further."""
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
    """Training iterations; by default chosen by kind of job and number of images."""
    long_side_px: int | None = None
    """Reduce training images to this long side."""
    test_every: int | None = None
    """Fine jobs only: hold out every Nth image and measure the model on it."""


class JobFailure(Answer):
    """Why a job failed."""

    code: str
    message: str
    hint: str
    retryable: bool
    stage: str | None


class JobData(Answer):
    """A job and its progress."""

    id: str
    scene_id: str
    kind: JobKind
    state: JobState
    stage: str | None
    progress: float
    """Of the whole job, in [0, 1]; never decreases within an attempt."""
    eta_s: float | None
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
