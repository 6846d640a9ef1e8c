"""How often a job broke off without coming any farther, whatever died of it: its worker may, which counts."""

from contextlib import suppress
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from fvs_engine.errors import StorageError
from fvs_engine.files.atomic import write_text_atomically
from fvs_service.jobs.port import JobTicket


class _Count(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")

    key: str
    tries: int = 0
    reached: float = 0.0
    """The job's progress when the last try was begun."""


class Tries:
    """The tries of one attempt at a job, in a file; each counts from its beginning until it is excused.

    Without a disk to write to nothing is counted: that fails a job by itself.
    """

    def __init__(self, folder: Path, ticket: JobTicket) -> None:
        self._file = folder / f"tries-{ticket.kind.value}.json"
        self._key = ticket.key

    def in_vain(self, progress: float) -> int:
        """How many tries broke off since the job came farther last; ``progress`` is where it is now."""
        count = self._read()
        return min(1, count.tries) if progress > count.reached else count.tries

    def begin(self, progress: float) -> None:
        """Count one more."""
        self._write(_Count(key=self._key, tries=self.in_vain(progress) + 1, reached=progress))

    def excuse(self) -> None:
        """The last one broke off for a reason that is not the job's."""
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
