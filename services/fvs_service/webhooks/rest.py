"""Webhooks over REST."""

from typing import Annotated

from fastapi import Depends, Response

from fvs_schema.webhooks import NewWebhook, Webhook, WebhookList, WebhookRequest
from fvs_service.gateway.rest.bodies import json_body
from fvs_service.gateway.rest.dependencies import App, Caller, SceneId, WebhookId, set_location, to_operate
from fvs_service.gateway.rest.routing import json_router

router = json_router("/v1", "webhooks")


@router.post("/scenes/{scene_id}/webhooks", status_code=201)
def create_webhook(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    request: Annotated[WebhookRequest, Depends(json_body(WebhookRequest, to_operate))],
    response: Response,
) -> NewWebhook:
    """Create a webhook: events of the scene from now on are sent to its URL, signed with its `secret`."""
    webhook = app.webhooks.create(caller, scene_id, request)
    set_location(response, f"/v1/webhooks/{webhook.id}")
    return webhook


@router.get("/scenes/{scene_id}/webhooks")
def list_webhooks(app: App, caller: Caller, scene_id: SceneId) -> WebhookList:
    """List the webhooks of a scene, the oldest first."""
    return app.webhooks.of_scene(caller, scene_id)


@router.post("/webhooks/{webhook_id}:enable")
def enable_webhook(app: App, caller: Caller, webhook_id: WebhookId) -> Webhook:
    """Try the deliveries of a webhook now, also when it is disabled; they go on where they ended."""
    return app.webhooks.enable(caller, webhook_id)


@router.get("/webhooks/{webhook_id:plain}")
def get_webhook(app: App, caller: Caller, webhook_id: WebhookId) -> Webhook:
    """Return a webhook and the state of its deliveries."""
    return app.webhooks.get(caller, webhook_id)


@router.delete("/webhooks/{webhook_id:plain}", status_code=204)
def delete_webhook(app: App, caller: Caller, webhook_id: WebhookId) -> None:
    """Delete a webhook; what it has not delivered is not sent."""
    app.webhooks.delete(caller, webhook_id)
