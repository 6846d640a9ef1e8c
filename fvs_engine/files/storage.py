"""Writing results so that a crash or a full disk leaves the last good state, and saying so clearly."""

import contextlib
import errno
import re
import shutil
from collections.abc import Iterator
from pathlib import Path

from fvs_engine.errors import StorageError
from fvs_engine.files.atomic import replacing

_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}
_IN_THE_WAY = {errno.ENOTDIR, errno.EEXIST}
_RESUME_HINT = "Free some space and run the same command again: it goes on from the last good state."


class DiskFullError(StorageError):
    """There is no room for the output."""

    code = "disk-full"


@contextlib.contextmanager
def storage_errors(path: Path) -> Iterator[None]:
    """Turn an ``OSError`` about ``path`` into a ``StorageError`` that names the file and the remedy."""
    try:
        yield
    except StorageError as error:
        cause = error.__cause__
        if _is_full(cause) and not isinstance(error, DiskFullError):
            raise DiskFullError(f"There is no room left to write {path}.", hint=_RESUME_HINT) from cause
        raise
    except OSError as error:
        name = error.filename2 or error.filename or path
        if _is_full(error):
            raise DiskFullError(f"There is no room left to write {name}.", hint=_RESUME_HINT) from error
        if error.errno in _IN_THE_WAY:
            raise StorageError(
                f"{name} cannot be created: a file is in the way.", hint="Choose another output folder."
            ) from error
        raise StorageError(
            f"{name} cannot be written: {error.strerror or error}.",
            hint="Choose an output folder that you may write to.",
        ) from error


def _is_full(error: BaseException | None) -> bool:
    """Whether an error means that there is no room; safetensors puts the number into its sentence."""
    if not isinstance(error, OSError):
        return False
    named = re.search(r"os error (\d+)", str(error))
    return error.errno in _FULL or (named is not None and int(named[1]) in _FULL)


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file that is either the old one or the new one, whatever happens. Raises ``StorageError``."""
    with storage_errors(path), replacing(path) as temporary:
        temporary.write_bytes(content)


def require_free_bytes(folder: Path, needed_bytes: int) -> None:
    """Raise ``DiskFullError`` unless the disk of ``folder`` (or of its nearest parent) has the room."""
    existing = next(parent for parent in (folder, *folder.absolute().parents) if parent.exists())
    free_bytes = shutil.disk_usage(existing).free
    if free_bytes < needed_bytes:
        raise DiskFullError(
            f"The disk of {folder} has {free_bytes / 1e6:,.0f} MB left, "
            f"and this reconstruction needs about {needed_bytes / 1e6:,.0f} MB.",
            hint="Free some space, or choose an output folder on another disk.",
        )


@contextlib.contextmanager
def blame_full_disk(folder: Path) -> Iterator[None]:
    """For native code that reports a full disk in words of its own: look at the disk when it fails."""
    try:
        yield
    except (StorageError, MemoryError):
        raise
    except Exception as error:
        if shutil.disk_usage(folder).free < 1_000_000:
            raise DiskFullError(f"The disk of {folder} is full.", hint=_RESUME_HINT) from error
        raise
