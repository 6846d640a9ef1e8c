"""Working folders of no scene, and uploads that nobody finished."""

import shutil
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path

from sqlalchemy import select

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.lock import locked_folder
from fvs_service.application import Storage
from fvs_service.doctor.finding import Finding
from fvs_service.settings import Settings
from fvs_service.storage.tables import SceneRow


def folders_of_no_scene(storage: Storage, before: datetime) -> Iterator[Finding]:
    """Working folders on this machine whose scene does not exist."""
    folder = storage.settings.scenes
    names = {found.name for found in folder.iterdir()} if folder.is_dir() else set()
    with storage.database.reading() as session:
        names -= set(session.scalars(select(SceneRow.id)))
    for name in sorted(names):
        if _is_older(folder / name, before):
            yield Finding(
                "working folder of no scene",
                str(folder / name),
                "remove it",
                lambda path=folder / name: _remove(path),  # type: ignore[misc]
            )


def abandoned_uploads(settings: Settings, before: datetime) -> Iterator[Finding]:
    """Files of uploads that cannot be continued, and that nothing has been written to for a while."""
    for file in sorted(settings.uploads.glob("*.part")):
        if _is_older(file, before):
            yield Finding(
                "abandoned upload",
                str(file),
                "remove it",
                lambda file=file: file.unlink(missing_ok=True),  # type: ignore[misc]
            )


def _is_older(path: Path, before: datetime) -> bool:
    try:
        return datetime.fromtimestamp(path.stat().st_mtime, UTC) < before
    except FileNotFoundError:
        return False


def _remove(folder: Path) -> None:
    try:
        with locked_folder(folder):
            shutil.rmtree(folder, ignore_errors=True)
    except (OutputExistsError, StorageError):  # a runner uses it, and ends with its scene; or it is gone
        return
