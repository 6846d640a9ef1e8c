"""Removes a worker's copies of deleted images from the folders of its scenes.

The events tell which scenes have lost an image, so that nothing else is read while nothing is deleted.
"""

import shutil
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path

import structlog
from sqlalchemy import select
from sqlalchemy.orm import Session

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.lock import locked_folder
from fvs_schema.events import EventKind
from fvs_schema.masks import MASKS
from fvs_service.application import Storage
from fvs_service.events.repository import last_number
from fvs_service.images.files import ARRIVALS, IMAGES, READY, file_stem
from fvs_service.storage.tables import EventRow, ImageRow, SceneRow

_log = structlog.get_logger()

WithoutJobs = Callable[[Path], AbstractContextManager[bool]]
"""Keeps jobs away from a scene's folder during a block; gives False when one may use it."""


@contextmanager
def unless_locked(folder: Path) -> Iterator[bool]:
    """Lock a scene's folder during the block; yields False when that is not possible now."""
    with ExitStack() as held:
        try:
            held.enter_context(locked_folder(folder))
        except (OutputExistsError, StorageError):
            yield False
        else:
            yield True


class DeletedImages:
    """Removes the copies of deleted images; those of a scene in use wait until it is free."""

    def __init__(self, storage: Storage, without_jobs: WithoutJobs) -> None:
        self._database = storage.database
        self._folder = storage.settings.scenes
        self._without_jobs = without_jobs
        self._seen: int | None = None
        """The newest event whose deletion is known; None: none is, because the worker was away."""
        self._waiting: set[str] = set()

    def remove(self) -> None:
        """Remove what was deleted since the last call, and what could not be removed then."""
        self._waiting |= self._scenes_with_deletions()
        for scene_id in sorted(self._waiting):
            try:
                if self._is_done(scene_id):
                    self._waiting.discard(scene_id)
            except OSError as error:  # the other scenes do not wait for this one
                _log.warning("copies of deleted images stay", scene=scene_id, reason=str(error))

    def _scenes_with_deletions(self) -> set[str]:
        """The scenes with a folder here that may have lost an image since the last call."""
        with self._database.reading() as session:
            newest = last_number(session)
            if newest == self._seen:
                return set()
            here = {found.name for found in self._folder.iterdir()} if self._folder.is_dir() else set()
            if self._seen is not None and newest > self._seen:
                here &= _with_deletions_after(session, self._seen)
        self._seen = newest
        return here

    def _is_done(self, scene_id: str) -> bool:
        """Remove the copies in the scene's folder; returns False when it is in use.

        A folder without any is left alone: its runner would forget its images, and read them again.
        """
        folder = self._folder / scene_id
        known = self._stems(scene_id)
        if known is None or not any(_copies(known, folder)):
            return True
        with self._without_jobs(folder) as free:
            if not free:
                return False
            kept = self._stems(scene_id)
            if kept is not None and (removed := _remove_all_but(kept, folder)):
                _log.info("copies of deleted images removed", scene=scene_id, copies=removed)
        return True

    def _stems(self, scene_id: str) -> frozenset[str] | None:
        """The stems of the files of the scene's images; None when there is no such scene."""
        with self._database.reading() as session:
            if session.get(SceneRow, scene_id) is None:
                return None
            images = session.execute(
                select(ImageRow.number, ImageRow.sha256).where(ImageRow.scene_id == scene_id)
            )
            return frozenset(file_stem(number, sha256) for number, sha256 in images)


def _with_deletions_after(session: Session, number: int) -> set[str]:
    deletions = select(EventRow.scene_id).where(
        EventRow.number > number, EventRow.kind == EventKind.IMAGE_DELETED.value
    )
    # The retention may have deleted the event of a deletion.
    trimmed = select(SceneRow.id).where(SceneRow.last_deleted_event > number)
    return {*session.scalars(deletions), *session.scalars(trimmed)}


def _remove_all_but(kept: frozenset[str], folder: Path) -> int:
    """Remove all other copies of images; returns the number of those that were complete."""
    gone = [file for file in _copies(kept, folder) if file.parent.name in (IMAGES, MASKS)]
    for part in (ARRIVALS, READY):  # left by a runner that was killed: no job writes there now
        shutil.rmtree(folder / part, ignore_errors=True)
    for file in gone:
        file.unlink(missing_ok=True)
    return len(gone)


def _copies(kept: frozenset[str], folder: Path) -> Iterator[Path]:
    """The copies of images that are not ``kept``, and what is on its way to be one."""
    for part in (ARRIVALS, READY, IMAGES, MASKS):
        for file in (folder / part).iterdir() if (folder / part).is_dir() else ():
            if part in (ARRIVALS, READY) or file.name.partition(".")[0] not in kept:
                yield file
