"""Webhooks: events of scenes, sent to other services."""

from pydantic import Field

from fvs_client.models.base import Answer, Input, Timestamp, Word
from fvs_client.models.events import EventKind


class WebhookState(Word):
    """Whether a webhook's deliveries succeed."""

    ACTIVE = "active"
    FAILING = "failing"
    """The last delivery failed; it is tried again, with growing pauses."""
    DISABLED = "disabled"
    """Deliveries failed for three days; none is tried until the webhook is enabled."""


class WebhookRequest(Input):
    """A webhook to create."""

    url: str
    events: tuple[EventKind, ...]


class WebhookData(Answer):
    """A webhook of a scene, and the state of its deliveries."""

    id: str
    scene_id: str
    url: str
    events: tuple[EventKind, ...]
    state: WebhookState
    delivered: int
    """The number of the last event that was delivered, or is not one to send."""
    pending: int
    """Number of events that wait for their delivery."""
    failures: int
    """Number of failed attempts since the last delivery."""
    failing_since: Timestamp | None
    error: str | None
    """Why the last attempt failed."""
    created_at: Timestamp
    delivered_at: Timestamp | None
    secret: str | None = Field(default=None, repr=False)
    """Signs the deliveries; only a webhook that was just created has it."""
