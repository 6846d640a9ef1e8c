"""Jobs: requests, states, errors."""

from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from fvs_schema.base import Input, Listing, Output, Page, Timestamp
from fvs_schema.checks import of_fields
from fvs_schema.findings import Notice
from fvs_schema.quantities import WHOLE, Count, Number
from fvs_schema.stages import Stage
from fvs_schema.words import Word


class JobKind(Word):
    """The kind of a job."""

    UPDATE = "update"
    """Register the pending images, and train the scene's models: a quick one, then the full one."""
    FINE = "fine"
    """Train the final model with the current cameras."""
    FRAMES = "frames"
    """Make images from the frames of the scene's videos. The upload of a video queues it."""


class JobState(Word):
    """The state of a job."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"

    @property
    def ended(self) -> bool:
        """Whether the state is final, unless the job is retried."""
        return self in (JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELED)


class JobRequest(Input):
    """A job to queue."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"kind": "update"}, {"kind": "fine", "iterations": 7000, "test_every": 8}]
        }
    )

    kind: JobKind
    """What to do."""
    iterations: Annotated[int, Field(strict=True, gt=0, le=100_000), WHOLE] | None = None
    """Training iterations of the full model of an update, or of the fine model; the default depends on the
    kind of job and the number of images. Of a scene's updates only the first can set it: later ones have no
    fewer, and with more images as many per image."""
    long_side_px: Annotated[int, Field(strict=True, ge=64, le=8192), WHOLE] | None = None
    """Train on images downscaled to this long side. Of a scene's updates only the first can set it."""
    test_every: Annotated[int, Field(strict=True, ge=2, le=1_000), WHOLE] | None = None
    """Hold every n-th image out of the training of a `fine` model and evaluate the model on them (papers use
    8). By default it is trained on all images."""

    @model_validator(mode="after")
    def _frames_train_nothing(self) -> Self:
        given = [name for name in ("iterations", "long_side_px") if getattr(self, name) is not None]
        if given and self.kind is JobKind.FRAMES:
            raise of_fields("a job that takes frames trains nothing", *given)
        return self

    @model_validator(mode="after")
    def _only_fine_models_are_tested(self) -> Self:
        if self.test_every is not None and self.kind is not JobKind.FINE:
            raise of_fields("test_every is for fine models: updates train on all images", "test_every")
        return self


class JobFailure(Output):
    """Why a job failed."""

    code: str
    """Stable, for programs."""
    message: str
    """What went wrong, in a sentence."""
    hint: str
    """What to do about it."""
    retryable: bool
    """Whether `…:retry` can succeed without a change."""
    stage: Stage | None
    """The stage that failed; null before the first."""


class WaitReason(Word):
    """Why a job waits."""

    QUEUE = "queue"
    """Other jobs go first."""
    SCENE = "scene"
    """Another job of the scene goes first: updates before fine models."""
    TENANT_LIMIT = "tenant-limit"
    """The tenant's limit of running jobs is reached."""
    MEMORY = "memory"
    """The workers' memory is in use."""
    DISK = "disk"
    """The workers' disks are full up to the reserve."""
    NO_WORKER = "no-worker"
    """No worker is alive."""
    CLUSTER = "cluster"
    """The cluster cannot be reached, or its nodes cannot run the job."""
    NODE = "node"
    """The CPUs or the memory of all nodes are in use."""
    GPU = "gpu"
    """All GPUs of the cluster are in use."""
    NO_NODE = "no-node"
    """No node of the cluster has what the job needs."""


class JobWaiting(Output):
    """Why a job does not run now, and when it may: it is queued, or pauses for others."""

    place: Count
    """Its position in the queue of all waiting jobs; the first is 1."""
    reason: WaitReason
    """Why it waits, for programs."""
    message: str
    """The reason as a sentence."""
    eta_s: Number | None
    """Estimated time until its turn; null while unknown."""


class Job(Output):
    """A job and its progress."""

    id: str
    """The id, `job_…`."""
    scene_id: str
    """The scene."""
    kind: JobKind
    """What it does."""
    request: JobRequest
    """The request that it came from."""
    state: JobState
    """Whether it is queued, runs, or how it ended."""
    stage: Stage | None
    """What it does now; null while it is queued."""
    progress: Annotated[Number, Field(ge=0, le=1)]
    """Progress of the whole job, in [0, 1]; never decreases within an attempt."""
    eta_s: Number | None
    """An estimate of the time that it still has to run."""
    waiting: JobWaiting | None = None
    """Why it does not run now; null while it runs, and when it has ended."""
    attempt: Count
    """Counts from 1; `…:retry` begins another."""
    cancel_requested: bool
    """Whether it ends as soon as it can."""
    warnings: tuple[Notice, ...]
    """What limits the use of the result."""
    error: JobFailure | None
    """Why it failed; null unless it has."""
    snapshot_id: str | None
    """The job's latest snapshot."""
    created_at: Timestamp
    """When it was queued."""
    started_at: Timestamp | None
    """When it first ran; null before."""
    finished_at: Timestamp | None
    """When it ended; null before."""


class JobPage(Page):
    """A page of the list of a scene's jobs."""

    state: tuple[JobState, ...] = Field(
        default=(), description="Only jobs in one of these states; by default all."
    )


class JobList(Listing[Job]):
    """Jobs of a scene, the newest first."""
