"""Webhooks on the wire."""

from typing import Annotated

from pydantic import ConfigDict, Field

from fvs_schema.base import Input, Output, Timestamp
from fvs_schema.events import EventKind
from fvs_schema.words import Word


class WebhookState(Word):
    """Whether a webhook's deliveries succeed."""

    ACTIVE = "active"
    FAILING = "failing"
    """The last delivery failed; it is tried again, with growing pauses."""
    DISABLED = "disabled"
    """Deliveries failed for three days; none is tried until the webhook is enabled."""


class WebhookRequest(Input):
    """A webhook to create."""

    model_config = ConfigDict(
        json_schema_extra={
            "examples": [{"url": "https://hooks.example/fvs", "events": ["job.succeeded", "job.failed"]}]
        }
    )

    url: Annotated[str, Field(max_length=2_000, pattern=r"^https?://[!-~]+$")]
    """Where events are sent. Its host is one that the operator allows."""
    events: Annotated[tuple[EventKind, ...], Field(min_length=1, max_length=32, fail_fast=True)]
    """The kinds of events to send; besides them `events.deleted`, where some were deleted undelivered."""


class Webhook(Output):
    """A webhook of a scene, and the state of its deliveries."""

    id: str
    """The id, `whk_…`."""
    scene_id: str
    """The scene."""
    url: str
    """Where events are sent."""
    events: tuple[EventKind, ...]
    """The kinds of events that are sent."""
    state: WebhookState
    """Whether deliveries succeed."""
    delivered: int
    """The number of the last event that was delivered, or is not one to send."""
    pending: int
    """Number of events that wait for their delivery."""
    failures: int
    """Number of failed attempts since the last delivery."""
    failing_since: Timestamp | None
    """When the first of these failed; null without one."""
    error: str | None
    """Why the last attempt failed."""
    created_at: Timestamp
    """When it was created."""
    delivered_at: Timestamp | None
    """When the last delivery succeeded; null before the first."""


class NewWebhook(Webhook):
    """A webhook that was just created, with its secret, which cannot be read again."""

    secret: str
    """Signs the deliveries (Standard Webhooks): `whsec_` and the key in base64."""


class WebhookList(Output):
    """The webhooks of a scene, the oldest first."""

    webhooks: tuple[Webhook, ...]
    """All of them."""
