"""What a job is."""

from enum import StrEnum
from typing import Annotated, Self

from pydantic import ConfigDict, Field, model_validator

from fvs_service.model import Count, Model, Number, Timestamp, WholeNumber


class JobKind(StrEnum):
    """What a job makes."""

    UPDATE = "update"
    """Takes up all images that have arrived, and trains the coarse model on."""
    FINE = "fine"
    """Trains the final model from the latest cameras."""


class JobState(StrEnum):
    """Where a job is in its life."""

    QUEUED = "queued"
    RUNNING = "running"
    SUCCEEDED = "succeeded"
    FAILED = "failed"
    CANCELED = "canceled"

    @property
    def ended(self) -> bool:
        """Whether nothing will change any more (unless it is retried)."""
        return self in (JobState.SUCCEEDED, JobState.FAILED, JobState.CANCELED)


class JobRequest(Model):
    """A job to be done."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"kind": "update"}, {"kind": "fine", "iterations": 7000, "test_every": 8}]
        }
    )

    kind: JobKind
    iterations: Annotated[WholeNumber, Field(gt=0, le=100_000)] | None = None
    """Training iterations; by default as many as the kind of job needs for the images there are."""
    long_side_px: Annotated[WholeNumber, Field(ge=64, le=8192)] | None = None
    """Train on images reduced to this long side."""
    test_every: Annotated[WholeNumber, Field(ge=2, le=1_000)] | None = None
    """Of a `fine` model: keep every so many-th image out of the training, and measure the model by it (papers
    use 8). By default it learns from all."""

    @model_validator(mode="after")
    def _only_fine_models_are_tested(self) -> Self:
        if self.test_every is not None and self.kind is not JobKind.FINE:
            raise ValueError("test_every is for fine models: an update learns from all images")
        return self


class JobError(Model):
    """Why a job failed."""

    code: str
    message: str
    hint: str
    retryable: bool
    stage: str | None


class Job(Model):
    """One job and how far it is."""

    id: str
    scene_id: str
    kind: JobKind
    request: JobRequest
    state: JobState
    stage: str | None
    progress: Annotated[Number, Field(ge=0, le=1)]
    """Of the whole job; never goes back within an attempt."""
    eta_s: Number | None
    attempt: Count
    cancel_requested: bool
    warnings: tuple[str, ...]
    error: JobError | None
    snapshot_id: str | None
    """The latest snapshot that the job made."""
    created_at: Timestamp
    started_at: Timestamp | None
    finished_at: Timestamp | None


class JobList(Model):
    """Jobs of a scene, the oldest first."""

    items: tuple[Job, ...]
    next: str | None
