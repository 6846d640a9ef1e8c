"""Retention of ended jobs: by age, and by their number in a scene."""

from datetime import timedelta

from sqlalchemy import ColumnElement, delete, exists, func, or_, select
from sqlalchemy.orm import Session

from fvs_service.jobs.repository import OPEN
from fvs_service.settings import Retention
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.tables import JobMilestoneRow, JobRow, SnapshotRow

_AT_ONCE = 500


class JobRetention:
    """Deletes old ended jobs, and the oldest ones of scenes that have too many.

    Jobs whose snapshot exists stay.
    """

    def __init__(self, database: Database, retention: Retention) -> None:
        self._database = database
        self._most, self._days = retention.jobs, retention.job_days
        self._seen = -1
        """Scenes without a job recorded at this time or later cannot have exceeded their limit since."""

    def apply(self) -> int:
        """Delete what is not kept any longer; returns the number of jobs."""
        with self._database.reading() as session:
            newest = session.scalar(select(func.max(JobRow.recorded_at_ms))) or 0
            scenes = {*self._with_new_jobs(session), *self._with_old_jobs(session)}
        deleted = sum(self._trim(scene_id) for scene_id in sorted(scenes))
        self._seen = newest
        return deleted

    def _with_new_jobs(self, session: Session) -> list[str]:
        if self._most is None:
            return []
        return list(
            session.scalars(select(JobRow.scene_id).where(JobRow.recorded_at_ms >= self._seen).distinct())
        )

    def _with_old_jobs(self, session: Session) -> list[str]:
        if self._days is None:
            return []
        oldest = (
            select(JobRow.scene_id, JobRow.created_at)
            .where(*_deletable())
            .order_by(*JobRow.oldest_first())
            .limit(_AT_ONCE)
            .subquery()
        )
        before = now() - timedelta(days=self._days)
        return list(session.scalars(select(oldest.c.scene_id).where(oldest.c.created_at < before).distinct()))

    def _trim(self, scene_id: str) -> int:
        deleted = 0
        while count := self._delete_some(scene_id):
            deleted += count
        return deleted

    def _delete_some(self, scene_id: str) -> int:
        with self._database.writing(scene_id) as session:
            query = select(JobRow.id).where(
                JobRow.scene_id == scene_id, *_deletable(), or_(*self._beyond(session, scene_id))
            )
            jobs = session.scalars(query.order_by(*JobRow.oldest_first()).limit(_AT_ONCE)).all()
            session.execute(delete(JobMilestoneRow).where(JobMilestoneRow.job_id.in_(jobs)))
            session.execute(delete(JobRow).where(JobRow.id.in_(jobs)))
        return len(jobs)

    def _beyond(self, session: Session, scene_id: str) -> list[ColumnElement[bool]]:
        """The conditions of which each puts a job beyond a limit."""
        beyond = []
        if self._most is not None:
            of_scene = select(JobRow.recorded_at_ms, JobRow.id).where(JobRow.scene_id == scene_id)
            newest_first = of_scene.order_by(*JobRow.newest_first())
            last_kept = session.execute(newest_first.offset(self._most - 1).limit(1)).first()
            beyond.append(JobRow.in_order() < tuple(last_kept or (-1, "")))
        if self._days is not None:
            beyond.append(JobRow.created_at < now() - timedelta(days=self._days))
        return beyond


def _deletable() -> tuple[ColumnElement[bool], ...]:
    return JobRow.state.not_in(OPEN), ~exists().where(SnapshotRow.job_id == JobRow.id)
