"""Keeping two processes from writing to one output folder."""

import contextlib
import fcntl
from collections.abc import Iterator
from pathlib import Path

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.storage import storage_errors

LOCK_NAME = ".lock"


@contextlib.contextmanager
def locked_folder(root: Path) -> Iterator[None]:
    """Keep other writers out of the folder ``root``, which must exist.

    Raises ``OutputExistsError`` when another process writes to it, ``StorageError`` when it cannot be written
    to or its file system knows no locks.
    """
    with storage_errors(root):
        lock = (root / LOCK_NAME).open("w")
    with lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputExistsError(
                f"Another process is writing to {root}.",
                hint="Wait until it is done, or choose another output folder.",
            ) from error
        except OSError as error:  # some network file systems
            raise StorageError(
                f"{root} lies on a file system that cannot lock files: {error.strerror}.",
                hint="Choose an output folder on a local disk.",
            ) from error
        yield
