"""Jobs: what the service is doing for a scene."""

from fvs_client.models.base import Answer, Input, Timestamp, Word


class JobKind(Word):
    """What a job makes."""

    UPDATE = "update"
    """Takes up all images that have arrived, and trains the coarse model on."""
    FINE = "fine"
    """Trains the final model from the latest cameras."""


class JobState(Word):
    """Where a job is in its life."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"


_ENDED = frozenset({JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELED})


class JobRequest(Input):
    """A job to be done."""

    kind: JobKind
    iterations: int | None = None
    """Training iterations; by default as many as the kind of job needs for the images there are."""
    long_side_px: int | None = None
    """Train on images reduced to this long side."""
    test_every: int | None = None
    """Of a fine model: keep every so many-th image out of the training, and measure the model by it."""


class JobFailure(Answer):
    """Why a job failed."""

    code: str
    message: str
    hint: str
    retryable: bool
    stage: str | None


class JobData(Answer):
    """One job and how far it is."""

    id: str
    scene_id: str
    kind: JobKind
    state: JobState
    stage: str | None
    progress: float
    """Of the whole job, in [0, 1]; never goes back within an attempt."""
    eta_s: float | None
    attempt: int
    cancel_requested: bool
    warnings: tuple[str, ...]
    error: JobFailure | None
    snapshot_id: str | None
    """The latest snapshot that the job made."""
    created_at: Timestamp
    started_at: Timestamp | None
    finished_at: Timestamp | None

    @property
    def ended(self) -> bool:
        """Whether nothing will change any more, unless it is retried."""
        return self.state in _ENDED
