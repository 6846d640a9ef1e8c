"""Rankings in the database."""

import orjson
from sqlalchemy import bindparam, insert, select
from sqlalchemy.orm import Session

from fvs_schema.base import Page
from fvs_schema.rankings import Ranking, RankingList, RankingSummary
from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.storage.database import Reader
from fvs_service.storage.pages import Cursors, newest_columns
from fvs_service.storage.tables import RankingRow, SceneRow, columns_of

_RANKINGS, _SCENES = columns_of(RankingRow), columns_of(SceneRow)
_RANKING = (
    select(_RANKINGS.c.document, _RANKINGS.c.scene_id, _SCENES.c.tenant_id)
    .join(_SCENES, _SCENES.c.id == _RANKINGS.c.scene_id)
    .where(_RANKINGS.c.id == bindparam("ranking_id"))
)


def add_ranking(session: Session, ranking: Ranking) -> None:
    """Add a ranking."""
    session.execute(
        insert(_RANKINGS),
        {
            "id": ranking.id,
            "scene_id": ranking.scene_id,
            "snapshot_id": ranking.snapshot_id,
            "document": orjson.Fragment(ranking.document),  # not through Python objects
            "created_at": ranking.created_at,
        },
    )


def rankings_of_scene(session: Session, scene_id: str, page: Page) -> RankingList:
    """The rankings of a scene, the newest first; refuses a cursor of another list."""
    document, first = RankingRow.document, ("candidates", 0)
    query = select(
        RankingRow.id,
        RankingRow.recorded_at_ms,
        RankingRow.snapshot_id,
        document["request", "method"].as_string().label("method"),
        document["request", "generator", "kind"].as_string().label("generator"),
        document["total"].as_integer().label("total"),
        document[*first, "id"].as_string().label("first"),
        document[*first, "rank"].as_integer().label("rank"),
        RankingRow.created_at,
    ).where(RankingRow.scene_id == scene_id)
    rows, following = newest_columns(session, query, RankingRow, page, Cursors("rankings", scene_id))
    listed = (
        RankingSummary(
            id=row.id,
            scene_id=scene_id,
            snapshot_id=row.snapshot_id,
            method=row.method,
            generator=row.generator,
            total=row.total,
            best=None if row.rank is None else row.first,
            created_at=row.created_at,
        )
        for row in rows
    )
    return RankingList(items=tuple(listed), next=following)


def ranking_of(reader: Reader, principal: Principal, ranking_id: str) -> Ranking:
    """A ranking of the principal's tenant; raises ``NotFoundError``."""
    found = reader.execute(_RANKING, {"ranking_id": ranking_id}).one_or_none()
    if found is None or not principal.owns(found.tenant_id, found.scene_id):
        raise NotFoundError("There is no such ranking.")
    return Ranking.model_validate(found.document)
