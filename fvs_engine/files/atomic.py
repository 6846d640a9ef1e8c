"""Files and folders that are replaced whole or not at all."""

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from fvs_engine.files.storage import storage_error


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; the file written there replaces ``path`` on success.

    The bytes are on disk before the name changes, so a crash leaves the old file or the new one. On any
    error the temporary file is removed; an ``OSError`` becomes a ``StorageError``.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield temporary
        flush_to_disk(temporary)
        temporary.replace(path)
        flush_to_disk(path.parent)
    except OSError as error:
        raise storage_error(error, path) from error
    finally:
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_text_atomically(path: Path, text: str) -> None:
    """Replace ``path`` by UTF-8 ``text``, whole or not at all; raises ``StorageError``."""
    write_bytes_atomically(path, text.encode())


def write_bytes_atomically(path: Path, content: bytes) -> None:
    """Replace ``path`` by ``content``, whole or not at all; raises ``StorageError``."""
    with replacing(path) as temporary:
        temporary.write_bytes(content)


def replace_folder(source: Path, target: Path) -> None:
    """Rename the folder ``source`` to ``target``, which may exist; its files are on disk before.

    A crash leaves ``source`` complete, or ``target``. Raises ``OSError``.
    """
    for folder, _, files in os.walk(source):
        for name in files:
            flush_to_disk(Path(folder, name))
        flush_to_disk(Path(folder))
    if target.exists():
        shutil.rmtree(target)
    source.replace(target)
    flush_to_disk(target.parent)


def flush_to_disk(path: Path) -> None:
    """Wait until a file, or the names in a folder, are on the disk; raises ``OSError``."""
    descriptor = os.open(path, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)
