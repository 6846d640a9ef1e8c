"""Retention: the snapshots, rankings and plans that a scene no longer keeps, by number and by age."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, or_, select
from sqlalchemy.orm import Session

from fvs_schema.scenes import SceneRequest
from fvs_service.deletion import rows
from fvs_service.deletion.service import open_job_ids
from fvs_service.settings import Retention
from fvs_service.storage.clock import now, now_ms
from fvs_service.storage.database import Database
from fvs_service.storage.tables import PlanRow, RankingRow, SceneRow, SnapshotRow

REASON = "retention"
"""The reason of a deletion in its event."""

_RESULTS_AT_ONCE = 500
_OF_SCENES = {"snapshots", "snapshot_days", "rankings", "ranking_days", "plans", "plan_days"}


@dataclass(frozen=True)
class _Kept:
    """The properties of a snapshot that retention depends on."""

    id: str
    kind: str
    job_id: str
    pinned: bool
    created_at: datetime
    recorded_at_ms: int


class RetentionRules:
    """Applies every scene's retention; numbers that a scene does not set are the service's."""

    def __init__(self, database: Database, usual: Retention, grace_s: float) -> None:
        self._database = database
        self._usual = usual
        self._grace = timedelta(seconds=grace_s)

    def apply(self) -> int:
        """Delete what no scene keeps any longer; returns the number of what was deleted."""
        return sum(self._apply_to(scene_id, retention) for scene_id, retention in self._scenes())

    def _scenes(self) -> list[tuple[str, Retention]]:
        """The scenes whose retention has a limit."""
        usual = self._usual.model_dump()
        with self._database.reading() as session:
            found = session.execute(select(SceneRow.id, SceneRow.request)).all()
        limited = []
        for scene_id, request in found:
            own = SceneRequest.model_validate(request).retention.model_dump(exclude_none=True)
            retention = Retention(**{**usual, **own})
            if retention.model_dump(include=_OF_SCENES, exclude_none=True):
                limited.append((scene_id, retention))
        return limited

    def _apply_to(self, scene_id: str, retention: Retention) -> int:
        deleted = 0
        while count := self._delete_some(scene_id, retention):
            deleted += count
        return deleted

    def _delete_some(self, scene_id: str, retention: Retention) -> int:
        with self._database.reading() as session:
            if not (
                self._snapshots(session, scene_id, retention) or any(_results(session, scene_id, retention))
            ):
                return 0
        with self._database.writing(scene_id) as session:  # decide again: nothing changes from here on
            snapshots = self._snapshots(session, scene_id, retention)
            rankings, plans = _results(session, scene_id, retention)
            for snapshot_id in snapshots:
                rows.delete_snapshot(session, scene_id, snapshot_id, REASON, self._grace)
            for ranking_id in rankings:
                rows.delete_ranking(session, scene_id, ranking_id, REASON)
            for plan_id in plans:
                rows.delete_plan(session, scene_id, plan_id, REASON)
        return len(snapshots) + len(rankings) + len(plans)

    def _snapshots(self, session: Session, scene_id: str, retention: Retention) -> list[str]:
        """The snapshots to delete.

        The current one stays, the newest of each kind, pinned ones, those of jobs in progress, and one that
        was the newest a moment ago: a ranking may be computed with it.
        """
        if retention.snapshots is None and retention.snapshot_days is None:
            return []
        snapshots = _newest_first(session, scene_id)
        current = session.scalar(select(SceneRow.snapshot_id).where(SceneRow.id == scene_id))
        stay = {current, *_newest_of_each_kind(snapshots)}
        jobs = open_job_ids(session, scene_id)
        oldest = _oldest(retention.snapshot_days)
        recently_ms = (session.scalar(select(now_ms())) or 0) - self._grace / timedelta(milliseconds=1)
        deleted = []
        newer: _Kept | None = None
        for place, snapshot in enumerate(snapshots):
            needed = snapshot.pinned or snapshot.id in stay or snapshot.job_id in jobs
            recent = newer is None or newer.recorded_at_ms > recently_ms
            beyond = retention.snapshots is not None and place >= retention.snapshots
            if not needed and not recent and (beyond or snapshot.created_at < oldest):
                deleted.append(snapshot.id)
            newer = snapshot
        return deleted


def _newest_first(session: Session, scene_id: str) -> list[_Kept]:
    found = session.execute(
        select(
            SnapshotRow.id,
            SnapshotRow.document["kind"].as_string(),
            SnapshotRow.job_id,
            SnapshotRow.pinned,
            SnapshotRow.created_at,
            SnapshotRow.recorded_at_ms,
        )
        .where(SnapshotRow.scene_id == scene_id)
        .order_by(*SnapshotRow.newest_first())
    )
    return [_Kept(*row) for row in found]


def _newest_of_each_kind(snapshots: Sequence[_Kept]) -> set[str]:
    return set({snapshot.kind: snapshot.id for snapshot in reversed(snapshots)}.values())


def _results(session: Session, scene_id: str, retention: Retention) -> tuple[list[str], list[str]]:
    """The rankings and the plans to delete, a limited number at a time."""
    rankings = _beyond(session, RankingRow, scene_id, retention.rankings, retention.ranking_days)
    return rankings, _beyond(session, PlanRow, scene_id, retention.plans, retention.plan_days)


def _beyond(
    session: Session,
    kind: type[RankingRow | PlanRow],
    scene_id: str,
    most: int | None,
    days: float | None,
) -> list[str]:
    beyond: list[ColumnElement[bool]] = []
    if most is not None:
        last_kept = session.execute(
            select(kind.recorded_at_ms, kind.id)
            .where(kind.scene_id == scene_id)
            .order_by(*kind.newest_first())
            .offset(most - 1)
            .limit(1)
        ).first()
        if last_kept is not None:
            beyond.append(kind.in_order() < tuple(last_kept))
    if days is not None:
        beyond.append(kind.created_at < _oldest(days))
    if not beyond:
        return []
    query = select(kind.id).where(kind.scene_id == scene_id, or_(*beyond))
    return list(session.scalars(query.order_by(*kind.oldest_first()).limit(_RESULTS_AT_ONCE)))


def _oldest(days: float | None) -> datetime:
    """The time before which what was made is too old."""
    return now() - timedelta(days=36_500 if days is None else days)
