"""Plans over REST."""

from typing import Annotated

from fastapi import Depends, Request, Response

from fvs_schema.plans import Plan, PlanList, PlanRequest
from fvs_service.gateway.rest.bodies import unread_json_body
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    Counters,
    IdempotencyKey,
    Paging,
    PlanId,
    SceneId,
    set_location,
    to_operate,
)
from fvs_service.gateway.rest.patience import TimeoutS, while_connected
from fvs_service.gateway.rest.routing import json_router
from fvs_service.plans.service import ReadRequest

router = json_router("/v1", "plans")


@router.post("/scenes/{scene_id}/plans", status_code=201)
async def plan_views(
    http: Request,
    app: App,
    metrics: Counters,
    caller: Caller,
    scene_id: SceneId,
    read: Annotated[ReadRequest, Depends(unread_json_body(PlanRequest, to_operate))],
    timeout_s: TimeoutS,
    response: Response,
    key: IdempotencyKey = None,
) -> Plan:
    """Plan which candidates to photograph next, in which order; possible while a job runs.

    Of all sets of `views` candidates within `distance_m` the one that leaves the targets best surrounded by
    photographs, in the order of a short flight, for one vehicle or several. Nothing is rendered.
    """
    with metrics.rankings_open.track_inprogress():
        plan = await while_connected(http, app.plans.create(caller, scene_id, read, timeout_s, key))
    set_location(response, f"/v1/plans/{plan.id}")
    return plan


@router.get("/scenes/{scene_id}/plans")
def list_plans(app: App, caller: Caller, scene_id: SceneId, page: Paging) -> PlanList:
    """List the plans of a scene, without their tours, the newest first."""
    return app.plans.of_scene(caller, scene_id, page)


@router.get("/plans/{plan_id}")
def get_plan(app: App, caller: Caller, plan_id: PlanId) -> Plan:
    """Return a plan."""
    return app.plans.get(caller, plan_id)


@router.delete("/plans/{plan_id}", status_code=204)
def delete_plan(app: App, caller: Caller, plan_id: PlanId) -> None:
    """Delete a plan."""
    app.deletions.plan(caller, plan_id)
