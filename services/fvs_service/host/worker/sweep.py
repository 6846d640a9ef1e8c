"""The sweeps of a worker: they apply the retention and remove what was deleted.

Of all workers one at a time removes rows and blobs; each removes working folders and copies of deleted images
on its own machine.
"""

import shutil
import threading
from collections.abc import Callable
from datetime import timedelta
from typing import TypeVar

import structlog
from sqlalchemy import CursorResult, update
from sqlalchemy.exc import IntegrityError

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.lock import locked_folder
from fvs_service.application import Storage
from fvs_service.deletion.event_retention import EventRetention
from fvs_service.deletion.idempotency_retention import IdempotencyRetention
from fvs_service.deletion.job_retention import JobRetention
from fvs_service.deletion.retention import RetentionRules
from fvs_service.errors import StorageUnavailableError
from fvs_service.host.worker.deleted_images import DeletedImages, WithoutJobs, unless_locked
from fvs_service.storage.clock import now, now_ms
from fvs_service.storage.removals import deleted_scenes
from fvs_service.storage.tables import SweepRow

_DELETION = "deletion"
_NAMES_AT_ONCE = 500

_log = structlog.get_logger()

T = TypeVar("T")


class Sweeps:
    """The sweeps of one worker, in a thread of their own: a large scene takes a while to remove."""

    def __init__(self, storage: Storage, without_jobs: WithoutJobs = unless_locked) -> None:
        self._storage = storage
        self._images = DeletedImages(storage, without_jobs)
        settings = storage.settings
        self._retention = RetentionRules(storage.database, settings.retention, settings.removal_grace_s)
        self._events = EventRetention(storage.database, settings.retention)
        self._jobs = JobRetention(storage.database, settings.retention)
        self._keys = IdempotencyRetention(storage.database, settings.retention)
        self._grace = timedelta(seconds=settings.removal_grace_s)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Sweep regularly from now on."""
        self._thread.start()

    def stop(self) -> None:
        """Start no further sweep; one that is under way may be interrupted at any point."""
        self._stop.set()

    def sweep(self) -> None:
        """Do what is due; what fails is logged, and the rest does not wait for it."""
        self._try("working folders", self.remove_working_folders)
        self._try("deleted images", self._images.remove)
        if self._is_mine():
            parts = {
                "deleted": self._retention.apply,
                "removed": self._storage.removals.run,
                "events": self._events.apply,
                "jobs": self._jobs.apply,
                "keys": self._keys.apply,
                "unfinished": self._remove_unfinished,
            }
            done = {name: self._try(name, part) for name, part in parts.items()}
            if any(done.values()):
                _log.info("swept", **done)

    def remove_working_folders(self) -> None:
        """Remove the working folders of deleted scenes from this machine."""
        folder = self._storage.settings.scenes
        names = [found.name for found in folder.iterdir()] if folder.is_dir() else []
        for start in range(0, len(names), _NAMES_AT_ONCE):
            with self._storage.database.reading() as session:
                deleted = deleted_scenes(session, names[start : start + _NAMES_AT_ONCE])
            for name in deleted:
                try:
                    with locked_folder(folder / name):
                        shutil.rmtree(folder / name, ignore_errors=True)
                except (OutputExistsError, StorageError):  # its runner is about to end
                    continue
                _log.info("working folder removed", scene=name)

    def _run(self) -> None:
        while not self._stop.wait(self._storage.settings.sweep_s):
            self._try("sweep", self.sweep)

    def _try(self, part: str, work: Callable[[], T]) -> T | None:
        """The result of a part of the sweep; None when it fails: the next sweep does it."""
        try:
            return work()
        except StorageUnavailableError as error:
            _log.warning("sweep put off", part=part, reason=error.message)
        except Exception:
            _log.exception("sweep failed", part=part)
        return None

    def _remove_unfinished(self) -> int:
        """Remove the files of writes that a crash interrupted; returns their number."""
        files = self._storage.blobs.unfinished(now() - self._grace)
        for file in files:
            file.unlink(missing_ok=True)
        return len(files)

    def _is_mine(self) -> bool:
        """Whether the sweep of rows and blobs is due and this worker's; others wait for the next one."""
        due = now_ms() + round(self._storage.settings.sweep_s * 1000)
        try:
            with self._storage.database.writing() as session:
                if session.get(SweepRow, _DELETION) is None:
                    session.add(SweepRow(name=_DELETION, due_at_ms=due))
                    return True
                taken = session.execute(
                    update(SweepRow)
                    .where(SweepRow.name == _DELETION, SweepRow.due_at_ms <= now_ms())
                    .values(due_at_ms=due)
                    .execution_options(synchronize_session=False)
                )
                return isinstance(taken, CursorResult) and taken.rowcount == 1
        except IntegrityError:  # another worker's first sweep
            return False
