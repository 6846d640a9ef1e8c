"""Plans in the database."""

import orjson
from sqlalchemy import bindparam, insert, select
from sqlalchemy.orm import Session

from fvs_schema.base import Page
from fvs_schema.plans import Plan, PlanList, PlanSummary
from fvs_service.errors import NotFoundError
from fvs_service.principal import Principal
from fvs_service.storage.database import Reader
from fvs_service.storage.pages import Cursors, newest_columns
from fvs_service.storage.tables import PlanRow, SceneRow, columns_of

_PLANS, _SCENES = columns_of(PlanRow), columns_of(SceneRow)
_PLAN = (
    select(_PLANS.c.document, _PLANS.c.scene_id, _SCENES.c.tenant_id)
    .join(_SCENES, _SCENES.c.id == _PLANS.c.scene_id)
    .where(_PLANS.c.id == bindparam("plan_id"))
)


def add_plan(session: Session, plan: Plan) -> None:
    """Add a plan."""
    session.execute(
        insert(_PLANS),
        {
            "id": plan.id,
            "scene_id": plan.scene_id,
            "snapshot_id": plan.snapshot_id,
            "document": orjson.Fragment(plan.model_dump_json().encode()),
            "created_at": plan.created_at,
        },
    )


def plan_of(reader: Reader, principal: Principal, plan_id: str) -> Plan:
    """A plan of the principal's tenant; raises ``NotFoundError``."""
    found = reader.execute(_PLAN, {"plan_id": plan_id}).one_or_none()
    if found is None or not principal.owns(found.tenant_id, found.scene_id):
        raise NotFoundError("There is no such plan.")
    return Plan.model_validate(found.document)


def plans_of_scene(session: Session, scene_id: str, page: Page) -> PlanList:
    """The plans of a scene, the newest first; refuses a cursor of another list."""
    query = select(
        PlanRow.id,
        PlanRow.recorded_at_ms,
        PlanRow.snapshot_id,
        PlanRow.document["summary"].as_string().label("summary"),
        PlanRow.created_at,
    ).where(PlanRow.scene_id == scene_id)
    rows, following = newest_columns(session, query, PlanRow, page, Cursors("plans", scene_id))
    listed = (
        PlanSummary(
            id=row.id,
            scene_id=scene_id,
            snapshot_id=row.snapshot_id,
            summary=row.summary,
            created_at=row.created_at,
        )
        for row in rows
    )
    return PlanList(items=tuple(listed), next=following)
