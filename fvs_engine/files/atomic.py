"""Files that are replaced whole or not at all."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from fvs_engine.errors import StorageError


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``; what was written there takes its place when all went well.

    The bytes are on disk before the name changes, so a crash leaves the old file or the new one. On any
    error the temporary file is removed; an ``OSError`` becomes a ``StorageError``.
    """
    temporary = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        yield temporary
        with temporary.open("rb") as written:
            os.fsync(written.fileno())
        temporary.replace(path)
        directory = os.open(path.parent, os.O_RDONLY)
        try:
            os.fsync(directory)
        finally:
            os.close(directory)
    except OSError as error:
        raise StorageError(
            f"{path} cannot be written: {error.strerror or error}.",
            hint="Check that the folder exists, is writable and has space.",
        ) from error
    finally:
        temporary.unlink(missing_ok=True)


def write_text_atomically(path: Path, text: str) -> None:
    """Put UTF-8 ``text`` into ``path``, whole or not at all; raises ``StorageError``."""
    with replacing(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
