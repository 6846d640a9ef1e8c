"""Reports and progress of uploads."""

import hashlib
import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from pathlib import Path

from fvs_client.image_files import ImageFile
from fvs_schema.images import Image, ImageMetadata
from fvs_schema.words import Word

Describe = Callable[[Path], ImageMetadata | None]

_READ_BYTES = 1 << 20


class Outcome(Word):
    """The outcome of the upload of one file."""

    SENT = "sent"
    ALREADY_THERE = "already-there"
    FAILED = "failed"


@dataclass(frozen=True)
class UploadedFile:
    """One file of an upload.

    ``image`` has the service's verdict; it is None when the file failed (``error`` has the reason), and when
    the scene had it already and the API key may not read images. ``mask_error``: why the image, which is in
    the scene, does not have its mask.
    """

    path: Path
    outcome: Outcome
    digest: str | None = None
    image: Image | None = None
    error: Exception | None = None
    mask_error: Exception | None = None

    @property
    def ok(self) -> bool:
        """Whether the file is usable and has its mask, if it has one."""
        return self.usable and self.mask_error is None

    @property
    def usable(self) -> bool:
        """Whether the file is in the scene and, as far as is known, can be used."""
        return self.error is None and (self.image is None or not self.image.rejected)


@dataclass(frozen=True)
class UploadReport:
    """The files of an upload, in order."""

    files: tuple[UploadedFile, ...]
    bytes_sent: int

    @property
    def sent(self) -> tuple[UploadedFile, ...]:
        """The files whose bytes were sent."""
        return self._with(Outcome.SENT)

    @property
    def already_there(self) -> tuple[UploadedFile, ...]:
        """The files that the scene had already, whose bytes were not sent."""
        return self._with(Outcome.ALREADY_THERE)

    @property
    def failed(self) -> tuple[UploadedFile, ...]:
        """The files that are not in the scene."""
        return self._with(Outcome.FAILED)

    @property
    def rejected(self) -> tuple[UploadedFile, ...]:
        """The files that are in the scene and cannot be used; ``image`` has verdict, reason and hint."""
        return tuple(file for file in self.files if file.image is not None and file.image.rejected)

    @property
    def without_mask(self) -> tuple[UploadedFile, ...]:
        """The files that are in the scene without their mask; ``mask_error`` has the reason."""
        return tuple(file for file in self.files if file.mask_error is not None)

    @property
    def ok(self) -> bool:
        """Whether every file arrived and can be used, with its mask."""
        return all(file.ok for file in self.files)

    def _with(self, outcome: Outcome) -> tuple[UploadedFile, ...]:
        return tuple(file for file in self.files if file.outcome is outcome)


@dataclass(frozen=True)
class UploadProgress:
    """Progress of an upload; ``bytes_done`` includes files that need not be sent, ``bytes_sent`` does not."""

    files_done: int
    files_total: int
    bytes_done: int
    bytes_total: int
    bytes_sent: int
    last: UploadedFile | None = None
    """The file finished last."""


class UploadCounter:
    """Counts files and bytes, and reports every change to ``on_progress``; thread-safe."""

    def __init__(
        self, files_total: int, bytes_total: int, on_progress: Callable[[UploadProgress], object] | None
    ) -> None:
        self._lock = threading.Lock()
        self._on_progress = on_progress
        self.progress = UploadProgress(0, files_total, 0, bytes_total, 0)
        self._report()

    def sent(self, size_bytes: int) -> None:
        """Count sent bytes; negative when they have to be sent again."""
        with self._lock:
            now = self.progress
            self.progress = replace(
                now,
                bytes_done=now.bytes_done + size_bytes,
                bytes_sent=now.bytes_sent + max(0, size_bytes),
            )
            self._report()

    def finished(self, file: UploadedFile, unsent_bytes: int = 0) -> None:
        """Count a finished file, of which ``unsent_bytes`` need not be sent."""
        with self._lock:
            now = self.progress
            self.progress = replace(
                now, files_done=now.files_done + 1, bytes_done=now.bytes_done + unsent_bytes, last=file
            )
            self._report()

    def _report(self) -> None:
        if self._on_progress is not None:
            self._on_progress(self.progress)


@dataclass(frozen=True)
class HashedFile:
    """A file and the digest (``sha256:…``) of its content."""

    file: ImageFile
    digest: str
    size_bytes: int

    @property
    def path(self) -> Path:
        """Where the file is."""
        return self.file.path


def hash_file(file: ImageFile) -> HashedFile | OSError:
    """Read a file and compute its digest; the error when it cannot be read."""
    digest, size_bytes = hashlib.sha256(), 0
    try:
        with file.path.open("rb") as content:
            while chunk := content.read(_READ_BYTES):
                digest.update(chunk)
                size_bytes += len(chunk)
    except OSError as error:
        return error
    return HashedFile(file, f"sha256:{digest.hexdigest()}", size_bytes)


def digest_of(content: bytes) -> str:
    """The digest (``sha256:…``) of the content of a file."""
    return f"sha256:{hashlib.sha256(content).hexdigest()}"


def total_size(files: Iterable[ImageFile]) -> int:
    """The sum of the sizes of ``files``, in bytes."""
    return sum(size_of(file.path) for file in files)


def size_of(path: Path) -> int:
    """Size in bytes; 0 when there is no such file."""
    try:
        return path.stat().st_size
    except OSError:
        return 0
