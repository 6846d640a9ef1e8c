"""Resumable uploads: an image that arrives in any number of requests (tus), whose offset survives restarts.

An upload is two files in a folder of its tenant: its description, and the bytes that have arrived. Their
number is the offset, so nothing is to be recovered after a crash; bytes that a power cut has damaged are
found by the image's digest. The id is derived from the image: an upload that is created again is the same.
"""

import contextlib
import hashlib
import os
import re
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Protocol

from pydantic import ValidationError

from fvs_engine.files.atomic import write_text_atomically
from fvs_schema.base import Model
from fvs_schema.images import ImageMetadata
from fvs_schema.names import Digest
from fvs_schema.quantities import Count
from fvs_service.errors import LimitExceededError, NotFoundError, PayloadTooLargeError
from fvs_service.images.staging import StagedFile
from fvs_service.storage.blobs import full_disk_as_error

_ID = re.compile(r"^upl_[0-9a-f]{32}$")
_DESCRIPTION, _BYTES = ".json", ".part"


class ResumableUpload(Model):
    """The image that an upload sends."""

    tenant_id: str
    scene_id: str
    digest: Digest
    size_bytes: Count
    metadata: ImageMetadata
    declared: str
    """The metadata as the client has written them."""

    @property
    def id(self) -> str:
        """Names the upload; others of the same image of the tenant have the same id."""
        named = "\n".join((self.tenant_id, self.scene_id, self.digest, str(self.size_bytes)))
        return f"upl_{hashlib.sha256(named.encode()).hexdigest()[:32]}"


class Hash(Protocol):
    """A hash of ``hashlib``."""

    def update(self, data: bytes, /) -> object:
        """Add bytes."""


class ResumableUploads:
    """The folder of resumable uploads; a tenant may have ``per_tenant`` unfinished ones, each for ``keep_s``.

    When a tenant has that many, a new one replaces the smallest of those that nothing has arrived of for
    ``spared_s``.
    """

    def __init__(self, folder: Path, *, keep_s: float, per_tenant: int, spared_s: float) -> None:
        self._folder = folder
        self._keep_s, self._per_tenant, self._spared_s = keep_s, per_tenant, spared_s
        self._lock = threading.Lock()
        self._open: set[Path] = set()

    def create(self, upload: ResumableUpload, *, finished: bool = False) -> None:
        """Create an upload, or give the one that exists another description; the bytes of it stay.

        ``finished``: the scene has the image, so no bytes are to come. Raises ``LimitExceededError``.
        """
        part = self._part(upload)
        with self._lock, full_disk_as_error():
            part.parent.mkdir(parents=True, exist_ok=True)
            if finished:
                part.unlink(missing_ok=True)
            elif not part.exists():
                self._make_room(part.parent)
                part.touch()
            write_text_atomically(part.with_suffix(_DESCRIPTION), upload.model_dump_json())

    def find(self, tenant_id: str, upload_id: str) -> ResumableUpload:
        """An upload of the tenant; raises ``NotFoundError``."""
        if _ID.match(upload_id):
            path = self._tenant(tenant_id) / f"{upload_id}{_DESCRIPTION}"
            with contextlib.suppress(FileNotFoundError, ValidationError):  # a power cut may leave half of it
                upload = ResumableUpload.model_validate_json(path.read_bytes())
                if time.time() < self._expires_at(upload):
                    return upload
        raise unknown_upload()

    def arrived_bytes(self, upload: ResumableUpload) -> int | None:
        """Number of bytes that have arrived; None when the upload is finished, deleted, or not yet there."""
        try:
            return self._part(upload).stat().st_size
        except FileNotFoundError:
            return None

    def expires_at(self, upload: ResumableUpload) -> datetime:
        """When the upload is deleted unless more bytes arrive."""
        return datetime.fromtimestamp(self._expires_at(upload), UTC)

    @contextlib.contextmanager
    def writer(self, upload: ResumableUpload, hashed: Hash | None = None) -> Iterator["UploadWriter"]:
        """Append to the upload; the new bytes are added to ``hashed``.

        One block at a time may do so for an upload (see ``UploadLocks``). Raises ``NotFoundError`` when it
        has been deleted.
        """
        part = self._part(upload)
        with self._kept(part):
            try:
                descriptor = os.open(part, os.O_WRONLY | os.O_APPEND | os.O_CLOEXEC)
            except FileNotFoundError:
                raise unknown_upload() from None
            try:
                yield UploadWriter(descriptor, upload.size_bytes, hashed)
            finally:
                os.close(descriptor)

    @contextlib.contextmanager
    def staged(self, upload: ResumableUpload) -> Iterator[StagedFile]:
        """The file of an upload whose bytes have all arrived; unless the block raises, it is then deleted."""
        part = self._part(upload)
        with self._kept(part):
            with part.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
            yield StagedFile(part, f"sha256:{digest}", upload.size_bytes)
            part.unlink(missing_ok=True)

    def discard_bytes(self, upload: ResumableUpload) -> None:
        """Delete the bytes of an upload that needs none: the scene has the image."""
        self._part(upload).unlink(missing_ok=True)

    def remove(self, upload: ResumableUpload) -> None:
        """Delete the upload and its bytes."""
        part = self._part(upload)
        part.with_suffix(_DESCRIPTION).unlink(missing_ok=True)
        part.unlink(missing_ok=True)

    def remove_scene(self, tenant_id: str, scene_id: str) -> None:
        """Delete the uploads of a scene that is gone; a request that sends one writes to no file any more."""
        for description in self._tenant(tenant_id).glob(f"*{_DESCRIPTION}"):
            with contextlib.suppress(OSError, ValidationError):  # what stays expires
                upload = ResumableUpload.model_validate_json(description.read_bytes())
                if upload.scene_id == scene_id:
                    self.remove(upload)

    def prune(self) -> None:
        """Delete uploads that have expired."""
        for tenant in self._folder.glob("*"):
            uploads: dict[str, list[Path]] = {}
            for path in tenant.iterdir():
                uploads.setdefault(path.name.lstrip(".").partition(".")[0], []).append(path)
            for upload_id, paths in uploads.items():
                with self._lock:
                    in_use = tenant / f"{upload_id}{_BYTES}" in self._open
                    if not in_use and max(map(_changed, paths)) + self._keep_s <= time.time():
                        for path in paths:
                            path.unlink(missing_ok=True)

    def _make_room(self, folder: Path) -> None:
        """Delete an upload if the tenant has too many; raises ``LimitExceededError``."""
        unfinished = list(folder.glob(f"*{_BYTES}"))
        if len(unfinished) < self._per_tenant:
            return
        spared_s = {path: self._left_s(path) for path in unfinished if path not in self._open}
        if not spared_s or min(spared_s.values()) > 0:
            raise LimitExceededError(
                f"{self._per_tenant} uploads are unfinished, and no more are allowed.",
                hint="Finish or delete one of them.",
                retry_after_s=max(1, round(min(spared_s.values(), default=self._spared_s))),
            )
        smallest = min((path for path, left_s in spared_s.items() if left_s <= 0), key=_size)
        smallest.with_suffix(_DESCRIPTION).unlink(missing_ok=True)
        smallest.unlink(missing_ok=True)

    def _left_s(self, part: Path) -> float:
        """Time for which an upload is still spared, never more than ``spared_s``."""
        left_s = _changed(part) + self._spared_s - time.time()
        # A file from further ahead was written before the clock was set back: how long ago, nobody knows.
        return 0.0 if left_s > 2 * self._spared_s else min(left_s, self._spared_s)

    @contextlib.contextmanager
    def _kept(self, part: Path) -> Iterator[None]:
        """Keep the upload from being deleted by age or for another one."""
        with self._lock:
            self._open.add(part)
        try:
            yield
        finally:
            with self._lock:
                self._open.discard(part)

    def _expires_at(self, upload: ResumableUpload) -> float:
        part = self._part(upload)
        return max(_changed(part), _changed(part.with_suffix(_DESCRIPTION))) + self._keep_s

    def _part(self, upload: ResumableUpload) -> Path:
        return self._tenant(upload.tenant_id) / f"{upload.id}{_BYTES}"

    def _tenant(self, tenant_id: str) -> Path:
        return self._folder / hashlib.sha256(tenant_id.encode()).hexdigest()[:16]


class UploadWriter:
    """Appends the bytes of one request to the file of an upload of ``size_bytes``."""

    def __init__(self, descriptor: int, size_bytes: int, hashed: Hash | None) -> None:
        self._descriptor, self._expected_bytes, self._hashed = descriptor, size_bytes, hashed
        self._began_at = self.size_bytes = os.fstat(descriptor).st_size

    def write(self, content: bytes) -> None:
        """Write the next bytes; raises ``PayloadTooLargeError`` and ``OutOfSpaceError``."""
        if len(content) > self.awaited_bytes:
            raise beyond_end(self._expected_bytes)
        with full_disk_as_error():
            left = memoryview(content)
            while left:
                written = os.write(self._descriptor, left)
                self.size_bytes += written
                left = left[written:]
        if self._hashed is not None:
            self._hashed.update(content)

    @property
    def awaited_bytes(self) -> int:
        """Number of bytes that may still be written."""
        return self._expected_bytes - self.size_bytes

    def undo(self) -> None:
        """Remove what this request has written."""
        os.ftruncate(self._descriptor, self._began_at)
        self.size_bytes = self._began_at


def unknown_upload() -> NotFoundError:
    """The error for an upload that does not exist, has expired, or belongs to others."""
    return NotFoundError(
        "There is no such upload.",
        hint="It may have expired. Create it again: POST /v1/uploads returns its offset.",
    )


def beyond_end(size_bytes: int) -> PayloadTooLargeError:
    """The error for bytes after the last one of an upload."""
    return PayloadTooLargeError(
        f"The body goes beyond the {size_bytes} bytes that Upload-Length declares.",
        hint="HEAD returns the offset at which the upload continues.",
    )


def _changed(path: Path) -> float:
    try:
        return path.stat().st_mtime
    except FileNotFoundError:
        return 0.0


def _size(path: Path) -> int:
    try:
        return path.stat().st_size
    except FileNotFoundError:
        return 0
