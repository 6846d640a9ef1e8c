"""Conversion of failed writes to ``StorageError``, and checks of free disk space."""

import contextlib
import errno
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from fvs_engine.errors import StorageError

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_IN_THE_WAY = {errno.ENOTDIR, errno.EEXIST}
_RESUME_HINT = "Free some space and run the same command again: it resumes from the last good state."


class DiskFullError(StorageError):
    """There is no room for the output."""

    code = "disk-full"


def storage_error(error: OSError, path: Path | str) -> StorageError:
    """The ``StorageError`` for an ``OSError`` that writing ``path`` raised."""
    if _is_full(error):
        return DiskFullError(f"There is no room left to write {path}.", hint=_RESUME_HINT, path=path)
    if error.errno in _IN_THE_WAY:
        return StorageError(
            f"{path} cannot be created: a file is in the way.",
            hint="Choose another output folder.",
            path=path,
        )
    return StorageError(
        f"{path} cannot be written: {error.strerror or error}.",
        hint="Check that its folder exists and is writable, or choose another one.",
        path=path,
    )


@contextlib.contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Turn an ``OSError`` into a ``StorageError`` that names the file it is about, ``path`` by default."""
    try:
        yield
    except OSError as error:
        raise storage_error(error, error.filename2 or error.filename or path) from error


def _is_full(error: OSError) -> bool:
    """Whether an error means that there is no room; safetensors gives the number only in the message."""
    named = re.search(r"os error (\d+)", str(error))
    return error.errno in _FULL or (named is not None and int(named[1]) in _FULL)


def require_free_bytes(folder: Path, needed_bytes: int) -> None:
    """Raise ``DiskFullError`` unless the disk of ``folder`` (or of its nearest parent) has the room."""
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free_bytes = shutil.disk_usage(existing).free
    if free_bytes < needed_bytes:
        raise DiskFullError(
            f"The disk of {folder} has {free_bytes / 1e6:,.0f} MB left, "
            f"and this reconstruction needs about {needed_bytes / 1e6:,.0f} MB.",
            hint="Free some space, or choose an output folder on another disk.",
            path=folder,
        )


@contextlib.contextmanager
def blame_full_disk(folder: Path) -> Iterator[None]:
    """Raise ``DiskFullError`` when native code, which hides why a write failed, fails on a full disk."""
    try:
        yield
    except (StorageError, MemoryError):
        raise
    except Exception as error:
        if shutil.disk_usage(folder).free < 1_000_000:
            raise DiskFullError(f"The disk of {folder} is full.", hint=_RESUME_HINT, path=folder) from error
        raise
