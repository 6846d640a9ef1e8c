"""Working copies: the folders of scenes in the object store, so that another machine can continue from them.

A scene's working copy is a tar of the files that its jobs continue from. It is stored before a snapshot is
committed and when a turn ends; the scene's row names the newest. A worker whose folder does not come from
that one replaces it. An older copy than the snapshot's would do, too: updates add all images that a folder
lacks.
"""

import shutil
import tarfile
from pathlib import Path

import structlog

from fvs_engine.files.atomic import write_text_atomically
from fvs_service.application import Storage
from fvs_service.ids import new_id
from fvs_service.scenes.lease import Lease, require_lease
from fvs_service.scenes.repository import set_working_copy, working_copy_of
from fvs_service.storage.blob_keys import working_copy_key
from fvs_service.storage.removals import ABANDONED_AFTER, keep, remove_later

_PARTS = ("growing", "fine", "choice.json")
"""Files needed to resume a job; all others can be recomputed."""
_MARKER = "working-copy"
"""The file with the name of the working copy that the folder comes from."""
_PARTIAL = "working-copy.partial"

_log = structlog.get_logger()


class WorkingCopies:
    """Stores and restores working copies; without effect when this machine has the only blobs."""

    def __init__(self, storage: Storage) -> None:
        self._storage = storage

    def store(self, lease: Lease) -> None:
        """Store the folder of the leased scene, while no job writes to it; raises ``StaleLeaseError``."""
        if not self._storage.blobs.shared:
            return
        scene_id, folder = lease.scene_id, self._folder(lease.scene_id)
        name, file = new_id("wrk"), folder / _PARTIAL
        key = working_copy_key(scene_id, name)
        try:
            with tarfile.open(file, "w") as tar:
                for part in _PARTS:
                    if (folder / part).exists():
                        tar.add(folder / part, part)
            with self._storage.database.writing(scene_id) as session:
                require_lease(session, lease)
                remove_later(session, scene_id, key, after=ABANDONED_AFTER)
            self._storage.blobs.adopt(file, key)
        finally:
            file.unlink(missing_ok=True)
        with self._storage.database.writing(scene_id) as session:
            require_lease(session, lease)
            earlier = working_copy_of(session, scene_id)
            if earlier is not None:
                remove_later(session, scene_id, working_copy_key(scene_id, earlier), after=ABANDONED_AFTER)
            keep(session, [key])
            set_working_copy(session, scene_id, name)
        write_text_atomically(folder / _MARKER, name)

    def restore(self, scene_id: str) -> None:
        """Replace the scene's folder with the newest working copy, unless it comes from it already."""
        if not self._storage.blobs.shared:
            return
        folder = self._folder(scene_id)
        with self._storage.database.reading() as session:
            newest = working_copy_of(session, scene_id)
        marker = folder / _MARKER
        if newest is None or (marker.exists() and marker.read_text(encoding="utf-8") == newest):
            return
        arrived, file = folder / "restored", folder / _PARTIAL
        file.unlink(missing_ok=True)
        self._storage.blobs.export(working_copy_key(scene_id, newest), file)
        shutil.rmtree(arrived, ignore_errors=True)
        with tarfile.open(file) as tar:
            # Python before 3.11.4 has no filters; the archive is one of the workers' own.
            tar.extraction_filter = getattr(tarfile, "data_filter", None)
            tar.extractall(arrived)
        file.unlink()
        marker.unlink(missing_ok=True)  # from here on the folder is of neither, until the new marker
        for part in _PARTS:
            _replace(folder / part, arrived / part)
        shutil.rmtree(arrived)
        write_text_atomically(marker, newest)
        _log.info("working copy restored", scene=scene_id, copy=newest)

    def _folder(self, scene_id: str) -> Path:
        return self._storage.settings.scenes / scene_id


def _replace(old: Path, new: Path) -> None:
    if old.is_dir():
        shutil.rmtree(old)
    else:
        old.unlink(missing_ok=True)
    if new.exists():
        new.rename(old)
