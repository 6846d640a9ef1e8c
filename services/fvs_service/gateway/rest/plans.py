"""Plans over REST."""

from typing import Annotated

from fastapi import Depends, Request

from fvs_service.gateway.rest.bodies import unread_json_body
from fvs_service.gateway.rest.dependencies import App, Caller, Counters, SceneId, to_operate
from fvs_service.gateway.rest.patience import TimeoutS, while_connected
from fvs_service.gateway.rest.routing import json_router
from fvs_service.plans.model import Plan, PlanRequest
from fvs_service.plans.service import ReadRequest

router = json_router("/v1", "plans")


@router.post("/scenes/{scene_id}/plans")
async def plan_views(
    http: Request,
    app: App,
    metrics: Counters,
    caller: Caller,
    scene_id: SceneId,
    read: Annotated[ReadRequest, Depends(unread_json_body(PlanRequest, to_operate))],
    timeout_s: TimeoutS,
) -> Plan:
    """Plan which candidates to photograph next, in which order; possible while a job runs.

    Of all sets of `views` candidates within `distance_m` the one that leaves the targets best surrounded by
    photographs, in the order of a short flight, for one vehicle or several. Nothing is rendered.
    """
    with metrics.rankings_open.track_inprogress():
        return await while_connected(http, app.plans.create(caller, scene_id, read, timeout_s))
