"""The number of tries of an attempt without progress, kept on disk because a job may kill its own worker."""

from contextlib import suppress
from pathlib import Path

from pydantic import ValidationError

from fvs_engine.errors import StorageError
from fvs_engine.files.atomic import write_text_atomically
from fvs_engine.records import Record
from fvs_service.jobs.states import Turn


class _Count(Record):
    key: str
    tries: int = 0
    reached: float = 0.0
    """The job's progress when the last try started."""
    reason: str = "its worker died"
    """Why the last try ended."""
    disk_full: bool = False
    """Whether it ended for lack of room."""


class Tries:
    """The tries of one attempt, in a file; each counts from its start unless it is excused.

    When the file cannot be written nothing is counted: on a full disk no try starts.
    """

    def __init__(self, folder: Path, turn: Turn) -> None:
        self._file = folder / f"tries-{turn.kind.value}.json"
        self._key = turn.attempt_id

    def without_progress(self, progress: float) -> int:
        """The number of tries since the job last made progress; ``progress`` is where it is now."""
        count = self._read()
        return min(1, count.tries) if progress > count.reached else count.tries

    @property
    def reason(self) -> str:
        """Why the last try ended."""
        return self._read().reason

    @property
    def disk_full(self) -> bool:
        """Whether the last try ended for lack of room."""
        return self._read().disk_full

    def because(self, reason: str, *, disk_full: bool = False) -> None:
        """Record why the last try ended."""
        self._write(self._read().model_copy(update={"reason": reason, "disk_full": disk_full}))

    def start(self, progress: float) -> None:
        """Count a try that starts now."""
        self._write(_Count(key=self._key, tries=self.without_progress(progress) + 1, reached=progress))

    def excuse(self) -> None:
        """Do not count the last try: the job did not cause its end."""
        count = self._read()
        self._write(count.model_copy(update={"tries": max(0, count.tries - 1)}))

    def _read(self) -> _Count:
        with suppress(OSError, ValidationError):
            count = _Count.model_validate_json(self._file.read_bytes())
            if count.key == self._key:
                return count
        return _Count(key=self._key)

    def _write(self, count: _Count) -> None:
        with suppress(StorageError, OSError):
            self._file.parent.mkdir(parents=True, exist_ok=True)
            write_text_atomically(self._file, count.model_dump_json())
