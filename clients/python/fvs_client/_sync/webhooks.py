# Generated from _async/webhooks.py by `make generate`. Do not edit.
"""Webhooks: create, get, list, enable and delete them."""

from collections.abc import Iterable
from typing import Self

from pydantic import Field

from fvs_client import requests
from fvs_client._sync.session import Resource, Session
from fvs_schema.base import Output
from fvs_schema.events import EventKind
from fvs_schema.webhooks import Webhook as WebhookData
from fvs_schema.webhooks import WebhookRequest


class Webhook(Resource, WebhookData):
    """A webhook as it was when it was fetched; ``refresh`` returns its current state."""

    secret: str | None = Field(default=None, repr=False)
    """Signs the deliveries; only a webhook that was just created has it."""

    def refresh(self) -> Self:
        """Get the webhook's current state."""
        return self._session.fetch(type(self), requests.get_webhook(self.id))

    def enable(self) -> Self:
        """Try the deliveries now, also when it is disabled; they go on where they ended."""
        return self._session.fetch(type(self), requests.enable_webhook(self.id))

    def delete(self) -> None:
        """Delete the webhook; what it has not delivered is not sent."""
        self._session.content(requests.delete_webhook(self.id))


class _WebhookList(Output):
    webhooks: tuple[Webhook, ...]


class Webhooks:
    """Webhooks by id."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, webhook_id: str) -> Webhook:
        """Get a webhook."""
        return self._session.fetch(Webhook, requests.get_webhook(webhook_id))


class SceneWebhooks:
    """The webhooks of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def create(self, url: str, events: Iterable[EventKind | str]) -> Webhook:
        """Send the scene's events of these kinds, from now on, to ``url``; its ``secret`` signs them.

        Raises ``InvalidRequestError`` for a host that the operator does not allow.
        """
        webhook = WebhookRequest(url=url, events=tuple(map(EventKind, events)))
        return self._session.fetch(Webhook, requests.create_webhook(self._scene_id, webhook))

    def list(self) -> tuple[Webhook, ...]:
        """All webhooks, oldest first."""
        return (self._session.fetch(_WebhookList, requests.list_webhooks(self._scene_id))).webhooks
