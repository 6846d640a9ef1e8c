"""Missions over REST."""

import json
from typing import Annotated, Any

from fastapi import Depends, Query, Response
from starlette.concurrency import run_in_threadpool

from fvs_schema.missions import MissionFile, MissionOptions, MissionRequest, PlanMissionOptions
from fvs_service.gateway.rest.bodies import unread_json_body
from fvs_service.gateway.rest.dependencies import App, Caller, PlanId, RankingId, SceneId, to_read
from fvs_service.gateway.rest.routing import json_router
from fvs_service.missions.formats.registry import WRITERS
from fvs_service.missions.service import ReadRequest

router = json_router("/v1", "missions")

_JSON: dict[str, dict[str, Any]] = {
    "application/json": {"schema": {}},
    "application/geo+json": {"schema": {"type": "object"}},
}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_KINDS = {writer.media_type.partition(";")[0] for writer in WRITERS.values()}
_CONTENT = {
    "description": "The file. `Left-Out` names the views that are not in it, separated by commas; "
    "`Left-Out-Reasons` is a JSON array of why the first of them are not, in the same order. "
    "`Mission-Parts` says into how many files the mission is cut; `Mission-Views` how many views this one "
    "photographs; `Mission-Length-M` and `Mission-Duration-S`, which poses lack, how far and long it flies.",
    # Generators that take the first for all can read each as bytes or text, but not as JSON.
    "content": dict.fromkeys(sorted(_KINDS - _JSON.keys()), _BINARY) | _JSON,
}
_FILE: dict[str, Any] = {"response_class": Response, "responses": {200: _CONTENT}}


@router.get("/rankings/{ranking_id}/mission", **_FILE)
def get_ranking_mission(
    app: App, caller: Caller, ranking_id: RankingId, options: Annotated[MissionOptions, Query()]
) -> Response:
    """Write the ranked candidates, in their order, as a mission for an autopilot or a ground station."""
    return _response(app.missions.of_ranking(caller, ranking_id, options))


@router.get("/plans/{plan_id}/mission", **_FILE)
def get_plan_mission(
    app: App, caller: Caller, plan_id: PlanId, options: Annotated[PlanMissionOptions, Query()]
) -> Response:
    """Write the stops of one vehicle of a plan as a mission for an autopilot or a ground station."""
    return _response(app.missions.of_plan(caller, plan_id, options))


@router.post("/scenes/{scene_id}/missions", **_FILE)
async def create_mission(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    options: Annotated[MissionOptions, Query()],
    read: Annotated[ReadRequest, Depends(unread_json_body(MissionRequest, to_read))],
) -> Response:
    """Write views, such as stops of plans or candidates of rankings, as a mission. It is not stored.

    Photographs of a snapshot, in place of views, are taken again.
    """
    return _response(await run_in_threadpool(app.missions.of_views, caller, scene_id, read, options))


def _response(file: MissionFile) -> Response:
    headers = {
        "Content-Disposition": f'attachment; filename="{file.name}"',
        "Mission-Parts": str(file.parts),
        "Mission-Views": str(file.views),
    }
    if file.length_m is not None and file.duration_s is not None:
        headers |= {
            "Mission-Length-M": f"{file.length_m:.1f}",
            "Mission-Duration-S": f"{file.duration_s:.1f}",
        }
    if file.left_out:
        headers["Left-Out"] = ",".join(file.left_out)
        headers["Left-Out-Reasons"] = json.dumps(file.reasons)
    return Response(file.content, headers=headers, media_type=file.media_type)
