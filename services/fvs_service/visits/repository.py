"""Visits in the database."""

from collections.abc import Collection, Sequence

from pydantic import TypeAdapter
from sqlalchemy import bindparam, delete, insert, or_, select
from sqlalchemy.orm import Session

from fvs_schema.poses import FramePose, Pose, VehiclePose
from fvs_schema.visits import Visit, VisitState
from fvs_service.storage.clock import now
from fvs_service.storage.database import Reader
from fvs_service.storage.tables import VisitRow, columns_of

_VISITS = columns_of(VisitRow)
_CURRENT = (
    select(_VISITS)
    .where(_VISITS.c.scene_id == bindparam("scene_id"), _VISITS.c.expires_at > bindparam("now"))
    .order_by(_VISITS.c.reported_at, _VISITS.c.vehicle, _VISITS.c.candidate_id, _VISITS.c.number)
)
_POSE: TypeAdapter[FramePose | VehiclePose] = TypeAdapter(Pose)


def visits_of(reader: Reader, scene_id: str) -> tuple[Visit, ...]:
    """The visits of a scene that have not expired, the oldest report first."""
    return tuple(numbered_visits_of(reader, scene_id).values())


def numbered_visits_of(reader: Reader, scene_id: str) -> dict[int, Visit]:
    """The same by their numbers, in the same order."""
    return {
        row.number: Visit(
            vehicle=row.vehicle,
            candidate_id=row.candidate_id,
            state=VisitState(row.state),
            pose=_POSE.validate_python(row.pose),
            reported_at=row.reported_at,
            expires_at=row.expires_at,
        )
        for row in reader.execute(_CURRENT, {"scene_id": scene_id, "now": now()})
    }


def taken_poses(reader: Reader, scene_id: str, vehicle: str | None) -> tuple[FramePose | VehiclePose, ...]:
    """The poses that are taken for ``vehicle``, or for one that gives no name.

    Those that others fly to; those whose photographs were taken; and those where it failed itself.
    """
    return tuple(visit.pose for visit in visits_of(reader, scene_id) if takes(visit, vehicle))


def takes(visit: Visit, vehicle: str | None) -> bool:
    """Whether the view is taken for ``vehicle``."""
    match visit.state:
        case VisitState.GOING_TO:
            return visit.vehicle != vehicle
        case VisitState.TAKEN:
            return True
        case VisitState.FAILED:
            return visit.vehicle == vehicle


def put_visits(session: Session, scene_id: str, visits: Sequence[Visit], replaced: Collection[int]) -> None:
    """Add visits; deletes those with the numbers ``replaced``, and expired ones."""
    outdated = or_(_VISITS.c.number.in_(replaced), _VISITS.c.expires_at <= now())
    session.execute(delete(_VISITS).where(_VISITS.c.scene_id == scene_id, outdated))
    rows = [
        {
            "scene_id": scene_id,
            "vehicle": visit.vehicle,
            "candidate_id": visit.candidate_id,
            "state": visit.state.value,
            "pose": visit.pose.model_dump(mode="json"),
            "reported_at": visit.reported_at,
            "expires_at": visit.expires_at,
        }
        for visit in visits
    ]
    session.execute(insert(_VISITS), rows)
