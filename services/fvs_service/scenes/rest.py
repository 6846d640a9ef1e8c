"""Scenes over REST."""

from typing import Annotated, Any

from fastapi import Depends, Response

from fvs_schema.control_points import ControlPoints
from fvs_schema.scenes import Scene, SceneChange, SceneList, SceneRequest, SceneSize
from fvs_service.gateway.rest.bodies import json_body
from fvs_service.gateway.rest.conditions import Expected, IfNoneMatch, has, not_modified, set_tag
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    IdempotencyKey,
    SceneId,
    ScenePaging,
    set_location,
    to_create_scenes,
    to_operate,
)
from fvs_service.gateway.rest.routing import json_router

router = json_router("/v1/scenes", "scenes")

_UNCHANGED: dict[int | str, dict[str, Any]] = {
    304: {"description": "The scene is as the one that `If-None-Match` names."}
}


@router.post("", status_code=201)
def create_scene(
    app: App,
    caller: Caller,
    request: Annotated[SceneRequest, Depends(json_body(SceneRequest, to_create_scenes))],
    response: Response,
    key: IdempotencyKey = None,
) -> Scene:
    """Create a scene."""
    scene = app.scenes.create(caller, request, key)
    set_location(response, f"/v1/scenes/{scene.id}")
    set_tag(response, scene.etag)
    return scene


@router.get("")
def list_scenes(app: App, caller: Caller, page: ScenePaging) -> SceneList:
    """List the scenes, the newest first."""
    return app.scenes.all(caller, page)


@router.get("/{scene_id}", response_model=Scene, responses=_UNCHANGED)
def get_scene(
    app: App, caller: Caller, scene_id: SceneId, response: Response, if_none_match: IfNoneMatch = None
) -> Scene | Response:
    """Return a scene: its numbers of images, its latest snapshot and its alignment."""
    scene = app.scenes.get(caller, scene_id)
    if has(scene.etag, if_none_match):
        return not_modified(scene.etag)
    set_tag(response, scene.etag)
    return scene


@router.patch("/{scene_id}")
def change_scene(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    change: Annotated[SceneChange, Depends(json_body(SceneChange, to_operate))],
    response: Response,
    expected: Expected,
) -> Scene:
    """Rename a scene, or change its policy or retention."""
    scene = app.scenes.change(caller, scene_id, change, expected)
    set_tag(response, scene.etag)
    return scene


@router.delete("/{scene_id}", status_code=204)
def delete_scene(app: App, caller: Caller, scene_id: SceneId, expected: Expected) -> None:
    """Permanently delete a scene and everything in it; its running jobs stop."""
    app.deletions.scene(caller, scene_id, expected)


@router.put("/{scene_id}/control-points")
def set_control_points(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    points: Annotated[ControlPoints, Depends(json_body(ControlPoints, to_operate))],
) -> ControlPoints:
    """Set the control points of a scene: the next update or fine job is aligned by them.

    They take the place of position priors. Marks may be in images that arrive later. A snapshot's `control`
    has the residuals.
    """
    return app.scenes.set_control_points(caller, scene_id, points)


@router.get("/{scene_id}/control-points")
def get_control_points(app: App, caller: Caller, scene_id: SceneId) -> ControlPoints:
    """Return the control points of a scene."""
    return app.scenes.control_points(caller, scene_id)


@router.delete("/{scene_id}/control-points", status_code=204)
def delete_control_points(app: App, caller: Caller, scene_id: SceneId) -> None:
    """Delete the control points of a scene: the next model is aligned by position priors."""
    app.scenes.delete_control_points(caller, scene_id)


@router.get("/{scene_id}/size")
def get_scene_size(app: App, caller: Caller, scene_id: SceneId) -> SceneSize:
    """Return the disk space of a scene: images, artifacts, and the worker's files."""
    return app.scenes.size(caller, scene_id)
