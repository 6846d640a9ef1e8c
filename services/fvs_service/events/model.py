"""Events of scenes."""

from enum import StrEnum
from typing import Any

from fvs_service.model import Model, Timestamp


class EventKind(StrEnum):
    """The kind of an event."""

    SCENE_CREATED = "scene.created"
    IMAGE_RECEIVED = "image.received"
    JOB_QUEUED = "job.queued"
    JOB_STARTED = "job.started"
    JOB_PROGRESS = "job.progress"
    JOB_SUCCEEDED = "job.succeeded"
    JOB_FAILED = "job.failed"
    JOB_CANCELED = "job.canceled"
    SNAPSHOT_CREATED = "snapshot.created"
    RANKING_CREATED = "ranking.created"


class Event(Model):
    """One event; ``number`` increases, and a client resumes after it."""

    number: int
    scene_id: str
    kind: EventKind
    data: dict[str, Any]
    created_at: Timestamp
