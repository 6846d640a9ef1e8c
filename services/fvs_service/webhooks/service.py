"""The operations on webhooks."""

from fvs_schema.webhooks import NewWebhook, Webhook, WebhookList, WebhookRequest
from fvs_service.errors import LimitExceededError
from fvs_service.events.repository import last_number
from fvs_service.ids import new_id
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.repository import scene_head_of
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.notifications import Topic, announce
from fvs_service.storage.tables import WebhookRow
from fvs_service.webhooks import repository
from fvs_service.webhooks.destinations import Destinations
from fvs_service.webhooks.sending import new_secret

_MOST = 10
"""Webhooks of a scene."""


class Webhooks:
    """Creates, lists, enables and deletes the webhooks of scenes."""

    def __init__(self, database: Database, destinations: Destinations) -> None:
        self._database, self._destinations = database, destinations

    def create(self, principal: Principal, scene_id: str, request: WebhookRequest) -> NewWebhook:
        """Create a webhook, which gets the events from now on.

        Raises ``InvalidRequestError`` for a host that the operator does not allow.
        """
        principal.require(Scope.OPERATE, scene_id)
        self._destinations.check(request.url)
        secret = new_secret()
        with self._database.writing(scene_id) as session:
            scene_head_of(session, principal, scene_id)
            if len(repository.webhooks_of_scene(session, scene_id)) >= _MOST:
                raise LimitExceededError(
                    f"A scene has at most {_MOST} webhooks.", hint="Delete one, or send its events on."
                )
            row = WebhookRow(
                id=new_id("whk"),
                scene_id=scene_id,
                tenant_id=principal.tenant_id,
                url=request.url,
                secret=secret,
                kinds=list(dict.fromkeys(kind.value for kind in request.events)),
                delivered=last_number(session),
                not_before_ms=0,
                failures=0,
                failing_since=None,
                error=None,
                disabled=False,
                created_at=now(),
                delivered_at=None,
            )
            session.add(row)
            session.flush()
            webhook = repository.to_webhook(session, row)
        return NewWebhook(**dict(webhook), secret=secret)

    def of_scene(self, principal: Principal, scene_id: str) -> WebhookList:
        """The webhooks of a scene."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_head_of(session, principal, scene_id)
            return WebhookList(webhooks=repository.webhooks_of_scene(session, scene_id))

    def get(self, principal: Principal, webhook_id: str) -> Webhook:
        """One webhook; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return repository.to_webhook(session, repository.webhook_of(session, principal, webhook_id))

    def enable(self, principal: Principal, webhook_id: str) -> Webhook:
        """Try a webhook's deliveries now, also when it is disabled; they go on where they ended."""
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            row = repository.webhook_of(session, principal, webhook_id)
            self._destinations.check(row.url)
            row.disabled, row.not_before_ms = False, 0
            row.failures, row.failing_since = 0, None
            session.flush()
            announce(session, Topic.EVENTS)
            return repository.to_webhook(session, row)

    def delete(self, principal: Principal, webhook_id: str) -> None:
        """Delete a webhook; what it has not delivered is not sent."""
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            repository.remove(session, repository.webhook_of(session, principal, webhook_id).id)
