"""Visits: several vehicles that photograph one scene get different views."""

from collections.abc import Callable, Mapping
from datetime import timedelta

from fvs_engine.geometry import RigidTransform
from fvs_schema.events import EventKind
from fvs_schema.visits import Visit, VisitList, VisitReport, VisitState
from fvs_service.errors import ConflictError, LimitExceededError
from fvs_service.events.repository import publish
from fvs_service.principal import Principal, Scope
from fvs_service.rankings.scene_geometry import SceneGeometry
from fvs_service.rankings.snapshot_frames import SnapshotFrames
from fvs_service.scenes.poses import WorldFrame
from fvs_service.scenes.repository import scene_head_of
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.visits.repository import numbered_visits_of, put_visits, takes, visits_of

_MOST = 1_000
"""Visits of a scene at one time."""


class Visits:
    """Records what vehicles do about views, for rankings and plans."""

    def __init__(self, database: Database, frames: SnapshotFrames) -> None:
        self._database = database
        self._frames = frames

    def report(self, principal: Principal, scene_id: str, report: VisitReport) -> VisitList:
        """Record visits; returns all of the scene.

        Raises ``ConflictError`` for views that are taken when the vehicle wants to go there: none of
        the report is recorded then. ``NoSnapshotError`` without a model, which views are candidates of.
        """
        principal.require(Scope.OPERATE, scene_id)
        with self._database.reading() as session:
            scene = scene_head_of(session, principal, scene_id)
        snapshot = self._frames.snapshot(principal, scene, None)
        frame = self._frames.frame(snapshot.id, scene.origin)
        cameras = frame.world_from_cameras([view.pose for view in report.views])
        wanted = dict(zip((view.id for view in report.views), cameras, strict=True))
        with self._database.writing(scene_id) as session:
            scene_head_of(session, principal, scene_id)  # it may have been deleted meanwhile
            visits = numbered_visits_of(session, scene_id)
            replaced = _replaced(visits, report, wanted, frame, lambda: self._frames.geometry(snapshot.id))
            others = [visit for number, visit in visits.items() if number not in replaced]
            if report.state is VisitState.GOING_TO:
                _require_free(wanted, others, report.vehicle, frame, self._frames.geometry(snapshot.id))
            if len(others) + len(report.views) > _MOST:
                raise LimitExceededError(
                    f"A scene has at most {_MOST} visits at a time.",
                    hint="Report only the next views of each vehicle, or let them expire sooner.",
                )
            put_visits(session, scene_id, _visits(report), replaced)
            views = [view.id for view in report.views]
            data = {"vehicle": report.vehicle, "state": report.state.value, "candidate_ids": views}
            publish(session, scene_id, EventKind.VISITS_REPORTED, data)
            return VisitList(visits=visits_of(session, scene_id))

    def of_scene(self, principal: Principal, scene_id: str) -> VisitList:
        """The visits of a scene that have not expired."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_head_of(session, principal, scene_id)
            return VisitList(visits=visits_of(session, scene_id))


def _replaced(
    visits: Mapping[int, Visit],
    report: VisitReport,
    wanted: Mapping[str, RigidTransform],
    frame: WorldFrame,
    geometry: Callable[[], SceneGeometry],
) -> frozenset[int]:
    """The numbers of earlier reports of the same vehicle about the same views.

    An id alone is not enough: the candidates of every ranking begin with the same ones.
    """
    poses = {view.id: view.pose for view in report.views}

    def is_same(visit: Visit) -> bool:
        name = visit.candidate_id
        if visit.vehicle != report.vehicle or name not in poses:
            return False
        if visit.pose == poses[name]:
            return True
        return bool(geometry().same_view({name: wanted[name]}, frame.known_cameras([visit.pose])))

    return frozenset(number for number, visit in visits.items() if is_same(visit))


def _visits(report: VisitReport) -> list[Visit]:
    reported = now()
    return [
        Visit(
            vehicle=report.vehicle,
            candidate_id=view.id,
            state=report.state,
            pose=view.pose,
            reported_at=reported,
            expires_at=reported + timedelta(seconds=report.expires_in_s),
        )
        for view in report.views
    ]


def _require_free(
    wanted: Mapping[str, RigidTransform],
    visits: list[Visit],
    vehicle: str,
    frame: WorldFrame,
    geometry: SceneGeometry,
) -> None:
    """Raise ``ConflictError`` for views that another vehicle flies to, or whose photograph was taken."""
    for visit in visits:
        if visit.state is VisitState.FAILED or not takes(visit, vehicle):
            continue
        near = sorted(geometry.same_view(wanted, frame.known_cameras([visit.pose])))
        if near:
            what = "flies to" if visit.state is VisitState.GOING_TO else "has photographed"
            raise ConflictError(
                f"Vehicle {visit.vehicle} {what} {near[0]}.",
                hint="Ask for a ranking with for_vehicle, and go to another view.",
            )
