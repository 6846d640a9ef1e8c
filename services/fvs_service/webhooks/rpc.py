"""Webhooks over gRPC."""

from fvs.v1 import webhooks_pb2 as pb

from fvs_schema.webhooks import NewWebhook, Webhook, WebhookList, WebhookRequest
from fvs_service.application import Application
from fvs_service.gateway.rpc.conversion import read
from fvs_service.principal import Principal, Scope


class WebhookServicer:
    """``fvs.v1.WebhookService``."""

    service = pb.DESCRIPTOR.services_by_name["WebhookService"]

    def __init__(self, app: Application) -> None:
        self._app = app

    def create_webhook(self, caller: Principal, request: pb.CreateWebhookRequest) -> NewWebhook:
        """Create a webhook."""
        self._app.scenes.require(caller, Scope.OPERATE, request.scene_id)
        return self._app.webhooks.create(caller, request.scene_id, read(WebhookRequest, request.webhook))

    def list_webhooks(self, caller: Principal, request: pb.ListWebhooksRequest) -> WebhookList:
        """List the webhooks of a scene."""
        return self._app.webhooks.of_scene(caller, request.scene_id)

    def get_webhook(self, caller: Principal, request: pb.GetWebhookRequest) -> Webhook:
        """Return a webhook."""
        return self._app.webhooks.get(caller, request.webhook_id)

    def enable_webhook(self, caller: Principal, request: pb.EnableWebhookRequest) -> Webhook:
        """Try the deliveries of a webhook now."""
        return self._app.webhooks.enable(caller, request.webhook_id)

    def delete_webhook(self, caller: Principal, request: pb.DeleteWebhookRequest) -> None:
        """Delete a webhook."""
        self._app.webhooks.delete(caller, request.webhook_id)
