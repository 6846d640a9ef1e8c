"""Rankings over REST."""

from typing import Annotated

from fastapi import APIRouter, Path, Response

from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    IdempotencyKey,
    RankingId,
    SceneId,
    set_location,
)
from fvs_service.rankings.model import Ranking, RankingRequest
from fvs_service.rankings.port import ViewImage

router = APIRouter(prefix="/v1", tags=["rankings"])

_PNG = {200: {"description": "A PNG image.", "content": {"image/png": {}}}}


@router.post("/scenes/{scene_id}/rankings", status_code=201)
def create_ranking(
    app: App,
    caller: Caller,
    scene_id: SceneId,
    request: RankingRequest,
    response: Response,
    key: IdempotencyKey = None,
) -> Ranking:
    """Rank candidates for the next image; possible while a job runs."""
    ranking = app.rankings.create(caller, scene_id, request, key)
    set_location(response, f"/v1/rankings/{ranking.id}")
    return ranking


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
def render_candidate(
    app: App,
    caller: Caller,
    ranking_id: RankingId,
    candidate_id: Annotated[str, Path(max_length=128, examples=["orbit-0000"])],
    image: ViewImage,
) -> Response:
    """Render a candidate's view of the ranking's snapshot, or the spectrum of it."""
    png = app.rankings.render(caller, ranking_id, candidate_id, image)
    return Response(png, media_type="image/png")
