"""Staging of uploads: each is written to a file while its digest is computed, one chunk at a time.

A file that is not moved into the blobs is deleted.
"""

import hashlib
import shutil
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from uuid import uuid4

from fvs_service.errors import PayloadTooLargeError
from fvs_service.storage.blobs import full_disk_as_error, require_room


@dataclass(frozen=True)
class StagedFile:
    """An upload that has fully arrived."""

    path: Path
    digest: str
    size_bytes: int


class StagingArea:
    """The folder of uploads in progress; emptied when the service starts."""

    def __init__(self, folder: Path, *, reserve_bytes: int, max_bytes: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder
        self._reserve_bytes = reserve_bytes
        self.max_bytes = max_bytes

    def clear(self) -> None:
        """Delete the files of a crashed service; only while there is no upload."""
        shutil.rmtree(self._folder)
        self._folder.mkdir()

    def receive(self, expected_bytes: int | None) -> "Receiver":
        """Start an upload; ``expected_bytes`` is its declared size, None without one.

        Raises ``PayloadTooLargeError`` or ``OutOfSpaceError`` early when the size is declared.
        """
        if expected_bytes is not None and expected_bytes > self.max_bytes:
            raise too_large(self.max_bytes)
        require_room(self._folder, expected_bytes or self.max_bytes, self._reserve_bytes)
        return Receiver(self._folder / f"{uuid4().hex}.upload", self.max_bytes)


class Receiver:
    """Writes the bytes of one upload; as a context it deletes them unless they were moved into the blobs."""

    def __init__(self, path: Path, max_bytes: int) -> None:
        self._path = path
        self._max_bytes = max_bytes
        self._hash = hashlib.sha256()
        self._size = 0
        with full_disk_as_error():
            self._file = path.open("wb")

    def __enter__(self) -> "Receiver":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._file.close()
        self._path.unlink(missing_ok=True)

    def write(self, chunk: bytes) -> None:
        """Write the next bytes; raises ``PayloadTooLargeError`` and ``OutOfSpaceError``."""
        self._size += len(chunk)
        if self._size > self._max_bytes:
            raise too_large(self._max_bytes)
        with full_disk_as_error():
            self._file.write(chunk)
        self._hash.update(chunk)

    def finish(self) -> StagedFile:
        """Close the file after its last byte."""
        with full_disk_as_error():
            self._file.close()
        return StagedFile(self._path, f"sha256:{self._hash.hexdigest()}", self._size)


def too_large(max_bytes: int) -> PayloadTooLargeError:
    """The error for a body that is larger than ``max_bytes``."""
    return PayloadTooLargeError(
        f"The body has more than {max_bytes} bytes.", hint="GET /v1/capabilities shows the limits."
    )
