"""Rankings over REST."""

from collections.abc import Callable
from typing import Annotated

from fastapi import Depends, Path, Request, Response
from starlette.concurrency import run_in_threadpool

from fvs_schema.rankings import Ranking, RankingList, RankingRequest
from fvs_schema.renders import RenderFormat, RenderRequest, ViewImage
from fvs_service.gateway.rest.bodies import unread_json_body
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    Counters,
    IdempotencyKey,
    Paging,
    RankingId,
    SceneId,
    SnapshotId,
    to_operate,
    to_read_snapshot,
)
from fvs_service.gateway.rest.patience import TimeoutS, while_connected
from fvs_service.gateway.rest.routing import json_router
from fvs_service.rankings.rest_stream import MEDIA_TYPE, ranking_stream
from fvs_service.rankings.service import ReadRequest

router = json_router("/v1", "rankings")

_STREAM = {
    200: {
        "description": "The parts of the ranking, as server-sent events.",
        "content": {MEDIA_TYPE: {"schema": {"type": "string"}}},
    }
}
_BINARY = {"schema": {"type": "string", "format": "binary"}}
_PNG = {200: {"description": "A PNG image.", "content": {"image/png": _BINARY}}}
_RENDER = {
    200: {
        "description": "The image, in the format of the request.",
        "content": {kind.media_type: _BINARY for kind in RenderFormat},
    }
}


@router.post(
    "/scenes/{scene_id}/rankings",
    status_code=201,
    response_model=Ranking,
    responses=_STREAM,  # type: ignore[arg-type]
)
async def rank_views(
    http: Request,
    app: App,
    metrics: Counters,
    caller: Caller,
    scene_id: SceneId,
    read: Annotated[ReadRequest, Depends(unread_json_body(RankingRequest, to_operate))],
    timeout_s: TimeoutS,
    key: IdempotencyKey = None,
) -> Response:
    """Rank candidates for the next image; possible while a job runs. Hanging up cancels it.

    With `Accept: text/event-stream` the response is a stream of server-sent events: `candidates` as they are
    scored (`id`, `score`, `status`, `coverage`, `distance_m`, `pose`), and last the `ranking`. An error after
    the first of them is an event `problem`.
    """
    if MEDIA_TYPE in http.headers.get("accept", ""):
        stream = app.rankings.stream(caller, scene_id, read, timeout_s, key)
        return await ranking_stream(http, metrics, stream)
    with metrics.rankings_open.track_inprogress():
        ranking = await while_connected(http, app.rankings.create(caller, scene_id, read, timeout_s, key))
    metrics.count_ranking(ranking.request.method, ranking.seconds, ranking.waited_s)
    return Response(
        ranking.document if ranking.is_small else await run_in_threadpool(lambda: ranking.document),
        status_code=201,
        headers={"Location": f"/v1/rankings/{ranking.id}"},
        media_type="application/json",
    )


@router.get("/scenes/{scene_id}/rankings")
def list_rankings(app: App, caller: Caller, scene_id: SceneId, page: Paging) -> RankingList:
    """List the rankings of a scene, without their candidates, the newest first."""
    return app.rankings.of_scene(caller, scene_id, page)


@router.get("/rankings/{ranking_id}")
def get_ranking(app: App, caller: Caller, ranking_id: RankingId) -> Ranking:
    """Return a ranking."""
    return app.rankings.get(caller, ranking_id)


@router.delete("/rankings/{ranking_id}", status_code=204)
def delete_ranking(app: App, caller: Caller, ranking_id: RankingId) -> None:
    """Delete a ranking and the renders of its candidates."""
    app.deletions.ranking(caller, ranking_id)


@router.get(
    "/rankings/{ranking_id}/candidates/{candidate_id}/{image}.png",
    response_class=Response,
    responses=_PNG,  # type: ignore[arg-type]
)
async def render_candidate(
    http: Request,
    app: App,
    metrics: Counters,
    caller: Caller,
    ranking_id: RankingId,
    candidate_id: Annotated[
        str, Path(max_length=128, description="The candidate's id.", examples=["orbit-0000"])
    ],
    image: Annotated[ViewImage, Path(description="Which image of the view.")],
    timeout_s: TimeoutS,
) -> Response:
    """Render a candidate's view of the ranking's snapshot, or the spectrum of it."""
    rendering = app.renders.of_candidate(caller, ranking_id, candidate_id, image, timeout_s)
    with metrics.rankings_open.track_inprogress():
        png = await while_connected(http, rendering)
    return Response(png, media_type="image/png")


@router.post(
    "/snapshots/{snapshot_id}/renders",
    response_class=Response,
    responses=_RENDER,  # type: ignore[arg-type]
)
async def render_view(
    http: Request,
    app: App,
    metrics: Counters,
    caller: Caller,
    snapshot_id: SnapshotId,
    read: Annotated[Callable[[], RenderRequest], Depends(unread_json_body(RenderRequest, to_read_snapshot))],
    timeout_s: TimeoutS,
) -> Response:
    """Render a snapshot at any pose, or the spectrum there. It is not stored; hanging up cancels it."""
    rendering = app.renders.at_pose(caller, snapshot_id, read, timeout_s)
    with metrics.rankings_open.track_inprogress():
        content, media_type = await while_connected(http, rendering)
    return Response(content, media_type=media_type)
