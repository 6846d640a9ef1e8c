"""Visits over REST."""

from typing import Annotated

from fastapi import Depends

from fvs_schema.visits import VisitList, VisitReport
from fvs_service.gateway.rest.bodies import json_body
from fvs_service.gateway.rest.dependencies import App, Caller, SceneId, to_operate
from fvs_service.gateway.rest.routing import json_router

router = json_router("/v1", "visits")


@router.post("/scenes/{scene_id}/visits")
def report_visits(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    report: Annotated[VisitReport, Depends(json_body(VisitReport, to_operate))],
) -> VisitList:
    """Report what a vehicle does about views, so that others get different ones.

    Views that it flies to (`going-to`) are taken for all others, until the report expires; 409 when one of
    them is taken already. Views whose photographs were `taken` are taken for all, also before these arrive.
    A view that `failed` is free for the others. Returns all current visits of the scene.
    """
    return app.visits.report(caller, scene_id, report)


@router.get("/scenes/{scene_id}/visits")
def list_visits(app: App, caller: Caller, scene_id: SceneId) -> VisitList:
    """List what vehicles do about views, until their reports expire."""
    return app.visits.of_scene(caller, scene_id)
