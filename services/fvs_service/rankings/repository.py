"""Rankings in the database."""

import orjson
from sqlalchemy import insert, select
from sqlalchemy.orm import Session

from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.rankings.model import Ranking
from fvs_service.storage.tables import RankingRow, SceneRow, columns_of


def add_ranking(session: Session, ranking: Ranking) -> None:
    """Add a ranking."""
    session.execute(
        insert(columns_of(RankingRow)),
        {
            "id": ranking.id,
            "scene_id": ranking.scene_id,
            "snapshot_id": ranking.snapshot_id,
            "document": orjson.Fragment(ranking.model_dump_json()),  # not through Python objects
            "created_at": ranking.created_at,
        },
    )


def ranking_of(session: Session, principal: Principal, ranking_id: str) -> Ranking:
    """A ranking of the principal's tenant; raises ``NotFoundError``."""
    found = session.execute(
        select(RankingRow, SceneRow)
        .join(SceneRow, SceneRow.id == RankingRow.scene_id)
        .where(RankingRow.id == ranking_id)
    ).one_or_none()
    if found is None or not principal.owns(found[1].tenant_id, found[1].id):
        raise NotFoundError("There is no such ranking.")
    return Ranking.model_validate(found[0].document)
