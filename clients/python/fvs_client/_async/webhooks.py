"""Webhooks: create, get, list, enable and delete them."""

from collections.abc import Iterable
from typing import Self

from pydantic import Field

from fvs_client import requests
from fvs_client._async.session import AsyncResource, AsyncSession
from fvs_schema.base import Output
from fvs_schema.events import EventKind
from fvs_schema.webhooks import Webhook as WebhookData
from fvs_schema.webhooks import WebhookRequest


class AsyncWebhook(AsyncResource, WebhookData):
    """A webhook as it was when it was fetched; ``refresh`` returns its current state."""

    secret: str | None = Field(default=None, repr=False)
    """Signs the deliveries; only a webhook that was just created has it."""

    async def refresh(self) -> Self:
        """Get the webhook's current state."""
        return await self._session.fetch(type(self), requests.get_webhook(self.id))

    async def enable(self) -> Self:
        """Try the deliveries now, also when it is disabled; they go on where they ended."""
        return await self._session.fetch(type(self), requests.enable_webhook(self.id))

    async def delete(self) -> None:
        """Delete the webhook; what it has not delivered is not sent."""
        await self._session.content(requests.delete_webhook(self.id))


class _AsyncWebhookList(Output):
    webhooks: tuple[AsyncWebhook, ...]


class AsyncWebhooks:
    """Webhooks by id."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, webhook_id: str) -> AsyncWebhook:
        """Get a webhook."""
        return await self._session.fetch(AsyncWebhook, requests.get_webhook(webhook_id))


class AsyncSceneWebhooks:
    """The webhooks of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    async def create(self, url: str, events: Iterable[EventKind | str]) -> AsyncWebhook:
        """Send the scene's events of these kinds, from now on, to ``url``; its ``secret`` signs them.

        Raises ``InvalidRequestError`` for a host that the operator does not allow.
        """
        webhook = WebhookRequest(url=url, events=tuple(map(EventKind, events)))
        return await self._session.fetch(AsyncWebhook, requests.create_webhook(self._scene_id, webhook))

    async def list(self) -> tuple[AsyncWebhook, ...]:
        """All webhooks, oldest first."""
        return (await self._session.fetch(_AsyncWebhookList, requests.list_webhooks(self._scene_id))).webhooks
