"""The files that uploads are written to, and the disk space that they need."""

import contextlib
import hashlib
import os
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Protocol

from fvs_service.errors import DigestMismatchError, PayloadTooLargeError
from fvs_service.storage.blobs import full_disk_as_error, require_room


@dataclass(frozen=True)
class StagedFile:
    """An upload that has fully arrived."""

    path: Path
    digest: str
    size_bytes: int


class Hash(Protocol):
    """A hash of ``hashlib``."""

    def update(self, data: bytes, /) -> object:
        """Add bytes."""


class Room:
    """The free disk space of a ``folder``, less what open uploads have reserved."""

    def __init__(self, folder: Path, reserve_bytes: int) -> None:
        self._folder, self._reserve_bytes = folder, reserve_bytes
        self._lock = threading.Lock()
        self._awaited: dict[object, Callable[[], int]] = {}

    @contextlib.contextmanager
    def kept(self, awaited_bytes: Callable[[], int]) -> Iterator[None]:
        """Keep room for an upload that may still write ``awaited_bytes``.

        Raises ``OutOfSpaceError`` unless there is room for these and those of all open uploads.
        """
        upload = object()
        with self._lock:
            awaited = sum(bytes_of() for bytes_of in self._awaited.values())
            require_room(self._folder, awaited_bytes(), self._reserve_bytes, awaited)
            self._awaited[upload] = awaited_bytes
        try:
            yield
        finally:
            with self._lock:
                del self._awaited[upload]


class Writer:
    """Writes the bytes of one request to the file of an upload of ``size_bytes``, from ``offset`` on.

    Bytes that had arrived there are replaced; those after the last one that is written stay. The new bytes
    are added to ``hashed``. Raises ``FileNotFoundError``.
    """

    def __init__(self, path: Path, size_bytes: int, offset: int = 0, hashed: Hash | None = None) -> None:
        self._descriptor = os.open(path, os.O_WRONLY | os.O_CLOEXEC)
        self._had_bytes = os.fstat(self._descriptor).st_size
        self._size_bytes, self.offset = size_bytes, offset
        self._whole = hashlib.sha256() if offset == 0 else None
        self._hashes = [one for one in (self._whole, hashed) if one is not None]

    def write(self, content: bytes) -> None:
        """Write the next bytes; raises ``PayloadTooLargeError`` and ``OutOfSpaceError``."""
        if len(content) > self.awaited_bytes:
            raise beyond_end(self._size_bytes)
        with full_disk_as_error():
            left = memoryview(content)
            while left:
                written = os.pwrite(self._descriptor, left, self.offset)
                self.offset += written
                left = left[written:]
        for one in self._hashes:
            one.update(content)

    @property
    def awaited_bytes(self) -> int:
        """Number of bytes that may still be written."""
        return self._size_bytes - self.offset

    @property
    def digest(self) -> str | None:
        """The digest of all bytes; None when those before the first that was written here are not known."""
        return None if self._whole is None else f"sha256:{self._whole.hexdigest()}"

    def undo(self) -> None:
        """Remove the bytes that this request has added."""
        os.ftruncate(self._descriptor, self._had_bytes)

    def close(self) -> None:
        """Close the file; it stays."""
        os.close(self._descriptor)


class Receiver:
    """Receives an image whose digest or size is not declared; cannot be continued when it breaks off.

    As a context it deletes the file unless that was moved into the blobs. Raises ``OutOfSpaceError``.
    """

    def __init__(self, path: Path, max_bytes: int, room: Room) -> None:
        self._path, self._max_bytes, self._ended = path, max_bytes, False
        with contextlib.ExitStack() as opened:
            opened.callback(lambda: path.unlink(missing_ok=True))
            with full_disk_as_error():
                path.touch()
                self._writer = Writer(path, max_bytes)
            opened.callback(self._writer.close)
            opened.enter_context(room.kept(lambda: 0 if self._ended else self._writer.awaited_bytes))
            self._opened = opened.pop_all()

    def __enter__(self) -> "Receiver":
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: BaseException | None, _trace: TracebackType | None
    ) -> None:
        self._opened.close()

    def write(self, content: bytes) -> None:
        """Write the next bytes; raises ``PayloadTooLargeError`` and ``OutOfSpaceError``."""
        if len(content) > self._writer.awaited_bytes:
            raise too_large(self._max_bytes)
        self._writer.write(content)

    def finish(self) -> StagedFile:
        """The file, after its last byte."""
        self._ended = True
        assert self._writer.digest is not None
        return StagedFile(self._path, self._writer.digest, self._writer.offset)


def file_digest(path: Path) -> str:
    """The digest of a file's bytes."""
    with path.open("rb") as file:
        return f"sha256:{hashlib.file_digest(file, 'sha256').hexdigest()}"


def too_large(max_bytes: int) -> PayloadTooLargeError:
    """The error for a body that is larger than ``max_bytes``."""
    return PayloadTooLargeError(
        f"The body has more than {max_bytes} bytes.", hint="GET /v1/capabilities shows the limits."
    )


def beyond_end(size_bytes: int) -> PayloadTooLargeError:
    """The error for bytes after the last one of an upload."""
    return PayloadTooLargeError(
        f"The body goes beyond the {size_bytes} bytes that the upload declares.",
        hint="Send the image's size, and no more bytes than that.",
    )


def require_digest(actual: str, *declared: str | None) -> None:
    """Raise ``DigestMismatchError`` unless all declared digests are ``actual``."""
    for digest in declared:
        if digest is not None and digest != actual:
            raise DigestMismatchError(
                f"The bytes have the digest {actual}, not {digest}.", hint="Send the image again."
            )
