"""Requests for the runners of cold scenes: written by gateways, taken by whichever worker is first."""

from sqlalchemy import delete, select
from sqlalchemy.exc import IntegrityError

from fvs_service.storage.database import Database
from fvs_service.storage.notifications import Topic, announce
from fvs_service.storage.tables import RunnerRequestRow


class RunnerRequests:
    """The requests of all scenes; one that is lost with its worker is made again by the waiting ranking."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, scene_id: str) -> None:
        """Have a worker start the scene's runner; no effect while that is requested already."""
        try:
            with self._database.writing() as session:
                if session.get(RunnerRequestRow, scene_id) is None:
                    session.add(RunnerRequestRow(scene_id=scene_id))
                announce(session, Topic.RUNNERS)
        except IntegrityError:
            pass  # requested by another gateway meanwhile

    def take(self) -> str | None:
        """Take one request: the id of its scene; None when there is none."""
        with self._database.reading() as session:
            scene_id = session.scalar(select(RunnerRequestRow.scene_id).limit(1))
        if scene_id is None:
            return None
        with self._database.writing() as session:
            return session.scalar(
                delete(RunnerRequestRow)
                .where(RunnerRequestRow.scene_id == scene_id)
                .returning(RunnerRequestRow.scene_id)
            )
