"""Events of scenes."""

from typing import Any

from fvs_schema.base import Output, Timestamp
from fvs_schema.words import Word


class EventKind(Word):
    """The kind of an event."""

    SCENE_CREATED = "scene.created"
    SCENE_CHANGED = "scene.changed"
    SCENE_DELETED = "scene.deleted"
    """The last event of its scene: streams end after it."""
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
    VISITS_REPORTED = "visits.reported"
    """A vehicle reported what it does about views."""
    EVENTS_DELETED = "events.deleted"
    """The stream lacks events: they and this number's were deleted by the retention."""


class Event(Output):
    """One event; ``number`` increases, and a client resumes after it."""

    number: int
    """Increases from event to event; a stream continues after it."""
    scene_id: str
    """The scene."""
    kind: EventKind
    """What happened."""
    data: dict[str, Any]
    """The ids and values that belong to this kind of event."""
    created_at: Timestamp
    """When it happened."""
