"""Exclusive lock of a folder, so that only one process writes to it."""

import contextlib
import fcntl
import time
from collections.abc import Iterator
from pathlib import Path

from fvs_engine.errors import OutputExistsError, StorageError
from fvs_engine.files.storage import storage_errors

LOCK_NAME = ".lock"
_POLL_S = 0.05


@contextlib.contextmanager
def locked_folder(root: Path, patience_s: float = 0.0) -> Iterator[None]:
    """Keep other writers out of the folder ``root``, which must exist; wait for them up to ``patience_s``.

    The lock ends with the process that holds it, however that ends. Raises ``OutputExistsError`` when another
    process still holds it, ``StorageError`` when the folder cannot be written to or its file system
    cannot lock files.
    """
    with storage_errors(root):
        lock = (root / LOCK_NAME).open("w")
    deadline = time.monotonic() + patience_s
    with lock:
        while True:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
                break
            except BlockingIOError as error:
                if time.monotonic() >= deadline:
                    raise OutputExistsError(
                        f"Another process is writing to {root}.",
                        hint="Wait until it is done, or choose another output folder.",
                        path=root,
                    ) from error
                time.sleep(_POLL_S)
            except OSError as error:  # some network file systems
                raise StorageError(
                    f"{root} lies on a file system that cannot lock files: {error.strerror}.",
                    hint="Choose an output folder on a local disk.",
                    path=root,
                ) from error
        yield
