"""Retention of events: by age, and by their number in a scene."""

from datetime import timedelta

from sqlalchemy import delete, func, select
from sqlalchemy.orm import Session

from fvs_service.events.repository import last_number
from fvs_service.settings import Retention
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.tables import EventRow, SceneRow

_OLDEST_LOOKED_AT = 1_000


class EventRetention:
    """Deletes old events, and the oldest events of scenes that have too many; the newest event stays.

    A scene remembers its last deleted event, so that a stream that resumes before it reports the gap. The
    last event of a deleted scene goes with the scene's other traces (see ``storage.removals``).
    """

    def __init__(self, database: Database, retention: Retention) -> None:
        self._database = database
        self._most, self._days = retention.events, retention.event_days
        self._seen = 0
        """Scenes without an event after this number cannot have exceeded their limit since."""

    def apply(self) -> int:
        """Delete what is not kept any longer; returns the number of events."""
        with self._database.reading() as session:
            newest = last_number(session)
            scenes = {*self._with_new_events(session), *self._with_old_events(session)}
        deleted = sum(self._trim(scene_id, newest) for scene_id in sorted(scenes))
        self._seen = newest
        return deleted

    def _with_new_events(self, session: Session) -> list[str]:
        if self._most is None:
            return []
        return list(session.scalars(select(EventRow.scene_id).where(EventRow.number > self._seen).distinct()))

    def _with_old_events(self, session: Session) -> list[str]:
        if self._days is None:
            return []
        oldest = (
            select(EventRow.scene_id, EventRow.created_at)
            .join(SceneRow, SceneRow.id == EventRow.scene_id)
            .order_by(EventRow.number)
            .limit(_OLDEST_LOOKED_AT)
            .subquery()
        )
        before = now() - timedelta(days=self._days)
        return list(session.scalars(select(oldest.c.scene_id).where(oldest.c.created_at < before).distinct()))

    def _trim(self, scene_id: str, newest: int) -> int:
        with self._database.writing(scene_id) as session:
            scene = session.get(SceneRow, scene_id)
            last = max(self._last_beyond_number(session, scene_id), self._last_beyond_age(session, scene_id))
            last = min(last, newest - 1)  # after which streams of new events begin
            beyond = (EventRow.scene_id == scene_id, EventRow.number <= last)
            count = session.scalar(select(func.count()).select_from(EventRow).where(*beyond)) or 0
            if scene is None or count == 0:
                return 0
            session.execute(delete(EventRow).where(*beyond))
            scene.last_deleted_event = max(last, scene.last_deleted_event)
            return count

    def _last_beyond_number(self, session: Session, scene_id: str) -> int:
        """The number of the newest event beyond the limit; 0 when there is none."""
        if self._most is None:
            return 0
        newest_first = select(EventRow.number).where(EventRow.scene_id == scene_id)
        return session.scalar(newest_first.order_by(EventRow.number.desc()).offset(self._most).limit(1)) or 0

    def _last_beyond_age(self, session: Session, scene_id: str) -> int:
        if self._days is None:
            return 0
        before = now() - timedelta(days=self._days)
        old = select(func.max(EventRow.number)).where(
            EventRow.scene_id == scene_id, EventRow.created_at < before
        )
        return session.scalar(old) or 0
