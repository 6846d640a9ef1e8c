"""Counts an attempt's starts without progress, in the job's row because a job may kill its own process."""

from contextlib import suppress

from sqlalchemy import select, update

from fvs_engine.records import Record
from fvs_service.errors import StorageUnavailableError
from fvs_service.jobs.states import Turn
from fvs_service.storage.database import Database
from fvs_service.storage.tables import JobRow


class _Count(Record):
    starts: int = 0
    reached: float = 0.0
    """The job's progress at the last start."""
    reason: str = "its process died"
    """What ended the last start."""
    disk_full: bool = False
    """Whether it ended because the disk was full."""


class Starts:
    """The starts of one attempt; a start counts unless it is excused."""

    def __init__(self, database: Database, turn: Turn) -> None:
        self._database = database
        self._row = (JobRow.id == turn.job_id, JobRow.attempt == turn.attempt)
        self._known: _Count | None = None

    def without_progress(self, progress: float) -> int:
        """The number of starts since the job last made progress; ``progress`` is where it is now."""
        count = self._count
        return min(1, count.starts) if progress > count.reached else count.starts

    @property
    def reason(self) -> str:
        """What ended the last start."""
        return self._count.reason

    @property
    def disk_full(self) -> bool:
        """Whether the last start ended because the disk was full."""
        return self._count.disk_full

    def begin(self, progress: float) -> None:
        """Count a start that is made now."""
        self._keep(_Count(starts=self.without_progress(progress) + 1, reached=progress))

    def because(self, reason: str, *, disk_full: bool = False) -> None:
        """Record what ended the last start."""
        with suppress(StorageUnavailableError):  # the next start records it
            self._keep(self._count.model_copy(update={"reason": reason, "disk_full": disk_full}))

    def excuse(self) -> None:
        """Do not count the last start: the job did not cause its end."""
        count = self._count
        with suppress(StorageUnavailableError):  # the next start records it
            self._keep(count.model_copy(update={"starts": max(0, count.starts - 1)}))

    @property
    def _count(self) -> _Count:
        if self._known is None:
            with self._database.reading() as session:
                document = session.scalar(select(JobRow.starts).where(*self._row))
            self._known = _Count.model_validate(document or {})
        return self._known

    def _keep(self, count: _Count) -> None:
        self._known = count
        with self._database.writing() as session:
            session.execute(update(JobRow).where(*self._row).values(starts=count.model_dump()))
