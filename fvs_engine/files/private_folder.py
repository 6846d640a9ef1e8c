"""Folders for what the processes of one user share on one machine, which no other user can enter or block."""

import contextlib
import os
import stat
import tempfile
from pathlib import Path

from fvs_engine.errors import StorageError
from fvs_engine.files.storage import storage_errors


def private_folder(name: str) -> Path:
    """The folder ``name`` of this user: in XDG_RUNTIME_DIR if that is set, else in the temporary folder.

    In the temporary folder another user may have made it first. Raises ``StorageError`` when it is not this
    user's, or cannot be made. Only this user can enter it, because anyone who can open a file can lock it.
    """
    runtime, user = os.environ.get("XDG_RUNTIME_DIR"), os.geteuid()
    folder = Path(runtime) / name if runtime else Path(tempfile.gettempdir()) / f"{name}-{user}"
    with storage_errors(folder):
        with contextlib.suppress(FileExistsError):
            folder.mkdir(mode=stat.S_IRWXU)
        found = folder.lstat()
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != user:
            raise StorageError(
                f"{folder} is not a folder of this user: another user may have made it.",
                hint="Remove it, or set XDG_RUNTIME_DIR to a folder that belongs to the user of the service.",
                path=folder,
            )
        if stat.S_IMODE(found.st_mode) != stat.S_IRWXU:
            folder.chmod(stat.S_IRWXU)
    return folder
