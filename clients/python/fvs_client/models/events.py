"""Events of a scene."""

from typing import Any

from fvs_client.models.base import Answer, Timestamp, Word


class EventKind(Word):
    """What an event reports."""

    SCENE_CREATED = "scene.created"
    SCENE_CHANGED = "scene.changed"
    SCENE_DELETED = "scene.deleted"
    """The last event of its scene."""
    IMAGE_RECEIVED = "image.received"
    IMAGE_EXCLUDED = "image.excluded"
    IMAGE_INCLUDED = "image.included"
    IMAGE_QUARANTINED = "image.quarantined"
    IMAGE_DELETED = "image.deleted"
    JOB_QUEUED = "job.queued"
    JOB_STARTED = "job.started"
    JOB_PROGRESS = "job.progress"
    JOB_SUCCEEDED = "job.succeeded"
    JOB_FAILED = "job.failed"
    JOB_CANCELED = "job.canceled"
    SNAPSHOT_CREATED = "snapshot.created"
    SNAPSHOT_DELETED = "snapshot.deleted"
    RANKING_CREATED = "ranking.created"
    RANKING_DELETED = "ranking.deleted"
    PLAN_CREATED = "plan.created"
    PLAN_DELETED = "plan.deleted"
    EVENTS_DELETED = "events.deleted"
    """The service no longer has the requested events up to this number: read the scene again."""


class Event(Answer):
    """An event; ``number`` increases, and ``scene.events(after=number)`` resumes after it."""

    number: int
    scene_id: str
    kind: EventKind
    data: dict[str, Any]
    created_at: Timestamp
