"""The operations that delete resources."""

from collections.abc import Collection
from datetime import timedelta

from sqlalchemy import select
from sqlalchemy.orm import Session

from fvs_service.deletion import rows
from fvs_service.errors import ConflictError, UnfinishedJobError
from fvs_service.images.uploads import Uploads
from fvs_service.jobs.repository import OPEN
from fvs_service.plans.repository import plan_of
from fvs_service.principal import Principal, Scope
from fvs_service.rankings.repository import ranking_of
from fvs_service.scenes.repository import find_scene_head, scene_head_of
from fvs_service.scenes.service import require_tag
from fvs_service.snapshots.repository import snapshot_of
from fvs_service.storage.database import Database
from fvs_service.storage.removals import lock_scene
from fvs_service.storage.tables import JobRow

REQUESTED = "requested"
"""The reason of a deletion in its event."""


class Deletions:
    """Deletes scenes, snapshots, rankings and plans; each is gone when the call returns."""

    def __init__(self, database: Database, uploads: Uploads, grace_s: float) -> None:
        self._database, self._uploads = database, uploads
        self._grace = timedelta(seconds=grace_s)

    def scene(self, principal: Principal, scene_id: str, expected: Collection[str] | None = None) -> None:
        """Delete a scene with its images, jobs, snapshots, rankings and plans; running jobs stop.

        Raises ``PreconditionFailedError`` unless the scene's tag is one of those ``expected``.
        """
        principal.require(Scope.OPERATE, scene_id)
        with self._database.writing(scene_id) as session:
            scene_head_of(session, principal, scene_id)
            require_tag(session, principal, scene_id, expected)
            rows.delete_scene(session, scene_id)
        self._uploads.remove_scene(principal.tenant_id, scene_id)

    def snapshot(self, principal: Principal, snapshot_id: str) -> None:
        """Delete a snapshot.

        Raises ``ConflictError`` for a pinned one, the scene's current one, and that of a job in progress.
        """
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            lock_scene(session, snapshot_of(session, principal, snapshot_id).scene_id)
            snapshot = snapshot_of(session, principal, snapshot_id)
            if find_scene_head(session, snapshot.scene_id).snapshot_id == snapshot_id:
                raise ConflictError(
                    "This is the scene's current model.",
                    hint="It can be deleted once an update has made a newer one, or with its scene.",
                )
            if snapshot.pinned:
                raise ConflictError(
                    "The snapshot is pinned.", hint='Unpin it first: PATCH {"pinned": false}.'
                )
            if snapshot.job_id in open_job_ids(session, snapshot.scene_id):
                raise UnfinishedJobError(
                    "The snapshot's job has not ended.",
                    hint="Try again when it has ended, or cancel it.",
                )
            rows.delete_snapshot(session, snapshot.scene_id, snapshot_id, REQUESTED, self._grace)

    def ranking(self, principal: Principal, ranking_id: str) -> None:
        """Delete a ranking with the renders of its candidates."""
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            lock_scene(session, ranking_of(session, principal, ranking_id).scene_id)
            ranking = ranking_of(session, principal, ranking_id)
            rows.delete_ranking(session, ranking.scene_id, ranking_id, REQUESTED)

    def plan(self, principal: Principal, plan_id: str) -> None:
        """Delete a plan."""
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            lock_scene(session, plan_of(session, principal, plan_id).scene_id)
            plan = plan_of(session, principal, plan_id)
            rows.delete_plan(session, plan.scene_id, plan_id, REQUESTED)


def open_job_ids(session: Session, scene_id: str) -> frozenset[str]:
    """The ids of a scene's jobs that have not ended."""
    return frozenset(
        session.scalars(select(JobRow.id).where(JobRow.scene_id == scene_id, JobRow.state.in_(OPEN)))
    )
