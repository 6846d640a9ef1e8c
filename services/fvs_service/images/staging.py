"""Staging of uploads: each is written to a file while its digest is computed, one chunk at a time.

A file that is not moved into the blobs is deleted.
"""

import contextlib
import hashlib
import shutil
import threading
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from uuid import uuid4

from fvs_service.errors import DigestMismatchError, PayloadTooLargeError
from fvs_service.storage.blobs import full_disk_as_error, require_room

_HASHED_BYTES = 1_048_576


@dataclass(frozen=True)
class StagedFile:
    """An upload that has fully arrived."""

    path: Path
    digest: str
    size_bytes: int


class StagingArea:
    """The ``folder`` of uploads in progress; emptied when the service starts."""

    def __init__(self, folder: Path, *, reserve_bytes: int, max_bytes: int) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.folder = folder
        self._reserve_bytes = reserve_bytes
        self.max_bytes = max_bytes
        self._lock = threading.Lock()
        self._awaited: dict[object, Callable[[], int]] = {}
        """The bytes that each open upload may still write."""

    def clear(self) -> None:
        """Delete the files of a crashed service; only while there is no upload."""
        shutil.rmtree(self.folder)
        self.folder.mkdir()

    def receive(
        self,
        expected_bytes: int | None,
        begin: Callable[[Path], object] | None = None,
        name: str = "",
        arrived_bytes: int = 0,
    ) -> "Receiver":
        """Start an upload; ``expected_bytes`` is its declared size, None without one.

        ``begin`` writes the file's first ``arrived_bytes``, when these arrived before. The file's name begins
        with ``name``, by which ``PartialUploads.recover`` knows the upload. Raises ``PayloadTooLargeError``
        early when the size is declared, and ``OutOfSpaceError`` unless there is room for the rest of this and
        of all open uploads.
        """
        if expected_bytes is not None and expected_bytes > self.max_bytes:
            raise too_large(self.max_bytes)
        size = self.max_bytes if expected_bytes is None else expected_bytes
        path = self.folder / f"{name}.{uuid4().hex}.upload"
        receiver: Receiver | None = None
        ended = self.expect(lambda: size - arrived_bytes if receiver is None else receiver.awaited_bytes)
        try:
            if begin is not None:
                begin(path)
            receiver = Receiver(path, self.max_bytes, size, ended)  # reads what arrived
        except BaseException:
            ended()
            raise
        return receiver

    def expect(self, awaited_bytes: Callable[[], int]) -> Callable[[], object]:
        """Keep room for an upload that may still write ``awaited_bytes``, until the result is called.

        Raises ``OutOfSpaceError`` unless there is room for these and those of all open uploads.
        """
        with self._lock:
            awaited = sum(bytes_of() for bytes_of in self._awaited.values())
            require_room(self.folder, awaited_bytes(), self._reserve_bytes, awaited)
            upload = object()
            self._awaited[upload] = awaited_bytes
        return lambda: self._ended(upload)

    def _ended(self, upload: object) -> None:
        with self._lock:
            self._awaited.pop(upload, None)


class Receiver:
    """Writes the bytes of one upload; as a context it deletes them unless they were moved into the blobs.

    ``expected_bytes``: its size, or the largest that it may have; ``ended`` is called when the context ends.
    """

    def __init__(self, path: Path, max_bytes: int, expected_bytes: int, ended: Callable[[], object]) -> None:
        self._path = path
        self._max_bytes = max_bytes
        self._expected_bytes = expected_bytes
        self._ended = ended
        self._hash = hashlib.sha256()
        self._size = 0
        with full_disk_as_error():
            self._file = path.open("a+b")
        self._file.seek(0)
        while chunk := self._file.read(_HASHED_BYTES):
            self._count(chunk)

    def __enter__(self) -> "Receiver":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._ended()
        with contextlib.suppress(OSError):  # of the last bytes, on a full disk
            self._file.close()
        self._path.unlink(missing_ok=True)

    def write(self, chunk: bytes) -> None:
        """Write the next bytes; raises ``PayloadTooLargeError`` and ``OutOfSpaceError``."""
        if self._size + len(chunk) > self._max_bytes:
            raise too_large(self._max_bytes)
        with full_disk_as_error():
            self._file.write(chunk)
        self._count(chunk)

    @property
    def awaited_bytes(self) -> int:
        """Number of bytes that may still be written."""
        return max(0, self._expected_bytes - self._size)

    @property
    def size_bytes(self) -> int:
        """Number of bytes written."""
        return self._size

    def part(self) -> Path:
        """The file of an upload that breaks off; it is deleted unless it is moved."""
        with full_disk_as_error():
            self._file.close()
        return self._path

    def _count(self, chunk: bytes) -> None:
        self._size += len(chunk)
        self._hash.update(chunk)

    def finish(self) -> StagedFile:
        """Close the file after its last byte."""
        self._expected_bytes = self._size
        with full_disk_as_error():
            self._file.close()
        return StagedFile(self._path, f"sha256:{self._hash.hexdigest()}", self._size)


def too_large(max_bytes: int) -> PayloadTooLargeError:
    """The error for a body that is larger than ``max_bytes``."""
    return PayloadTooLargeError(
        f"The body has more than {max_bytes} bytes.", hint="GET /v1/capabilities shows the limits."
    )


def require_digest(actual: str, *declared: str | None) -> None:
    """Raise ``DigestMismatchError`` unless all declared digests are ``actual``."""
    for digest in declared:
        if digest is not None and digest != actual:
            raise DigestMismatchError(
                f"The bytes have the digest {actual}, not {digest}.", hint="Send the image again."
            )
