"""Rankings in the database."""

import orjson
from sqlalchemy import bindparam, insert, select
from sqlalchemy.orm import Session

from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.rankings.model import Ranking
from fvs_service.storage.database import Reader
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


def ranking_of(reader: Reader, principal: Principal, ranking_id: str) -> Ranking:
    """A ranking of the principal's tenant; raises ``NotFoundError``."""
    found = reader.execute(_RANKING, {"ranking_id": ranking_id}).one_or_none()
    if found is None or not principal.owns(found.tenant_id, found.scene_id):
        raise NotFoundError("There is no such ranking.")
    return Ranking.model_validate(found.document)
