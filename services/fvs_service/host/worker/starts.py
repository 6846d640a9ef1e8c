"""Counts an attempt's starts without progress, on disk because a job may kill its own worker."""

from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from fvs_engine.errors import StorageError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.records import Record
from fvs_service.jobs.states import Turn


class _Count(Record):
    attempt_id: str
    starts: int = 0
    reached: float = 0.0
    """The job's progress at the last start."""
    reason: str = "its worker died"
    """What ended the last start."""
    disk_full: bool = False
    """Whether it ended because the disk was full."""


class Starts:
    """The starts of one attempt, in a file; a start counts unless it is excused.

    When the file cannot be written nothing is counted: on a full disk no attempt starts. ``lost``: how many
    were made elsewhere before there is a file.
    """

    def __init__(self, folder: Path, turn: Turn, lost: int = 0) -> None:
        self._file = folder / f"starts-{turn.kind.value}.json"
        self._attempt_id = turn.attempt_id
        self._lost = lost

    def without_progress(self, progress: float) -> int:
        """The number of starts since the job last made progress; ``progress`` is where it is now."""
        count = self._read()
        return min(1, count.starts) if progress > count.reached else count.starts

    @property
    def reason(self) -> str:
        """What ended the last start."""
        return self._read().reason

    @property
    def disk_full(self) -> bool:
        """Whether the last start ended because the disk was full."""
        return self._read().disk_full

    def because(self, reason: str, *, disk_full: bool = False) -> None:
        """Record what ended the last start."""
        self._write(self._read().model_copy(update={"reason": reason, "disk_full": disk_full}))

    def begin(self, progress: float) -> None:
        """Count a start that is made now."""
        starts = self.without_progress(progress) + 1
        self._write(_Count(attempt_id=self._attempt_id, starts=starts, reached=progress))

    def excuse(self) -> None:
        """Do not count the last start: the job did not cause its end."""
        count = self._read()
        self._write(count.model_copy(update={"starts": max(0, count.starts - 1)}))

    def _read(self) -> _Count:
        with suppress(OSError, ValidationError):
            count = _Count.model_validate_json(self._file.read_bytes())
            if count.attempt_id == self._attempt_id:
                return count
        return _Count(attempt_id=self._attempt_id, starts=self._lost)

    def _write(self, count: _Count) -> None:
        with suppress(StorageError, OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text_atomically(self._file, count.model_dump_json())
