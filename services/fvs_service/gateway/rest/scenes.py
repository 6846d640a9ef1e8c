"""Scenes over REST."""

from fastapi import APIRouter, Response

from fvs_service.gateway.rest.dependencies import App, Caller, IdempotencyKey, Paging, SceneId, set_location
from fvs_service.scenes.model import Scene, SceneList, SceneRequest

router = APIRouter(prefix="/v1/scenes", tags=["scenes"])


@router.post("", status_code=201)
def create_scene(
    app: App, caller: Caller, request: SceneRequest, response: Response, key: IdempotencyKey = None
) -> Scene:
    """Create a scene."""
    scene = app.scenes.create(caller, request, key)
    set_location(response, f"/v1/scenes/{scene.id}")
    return scene


@router.get("")
def list_scenes(app: App, caller: Caller, page: Paging) -> SceneList:
    """List the scenes, the oldest first."""
    return app.scenes.all(caller, page)


@router.get("/{scene_id}")
def get_scene(app: App, caller: Caller, scene_id: SceneId) -> Scene:
    """Return a scene: its numbers of images, its latest snapshot and its alignment."""
    return app.scenes.get(caller, scene_id)
