"""The store of uploads: the bytes that have arrived of each image; any transport may send the rest.

An upload is a file in a folder of its tenant. The file's name is the upload's id, which says which image of
which scene it is; its length is the offset at which the upload continues. So nothing needs recovery after a
crash; bytes that a power cut has damaged are found by the image's digest. An upload that was created by
itself (tus) has its metadata in a second file; over other transports they come with each request.
"""

import asyncio
import contextlib
import hashlib
import re
import threading
import time
from collections.abc import Iterator
from datetime import UTC, datetime
from pathlib import Path
from uuid import uuid4

import anyio.to_thread
import structlog
from pydantic import ValidationError

from fvs_engine.files.atomic import write_text_atomically
from fvs_schema.base import Model, Timestamp
from fvs_schema.images import ImageMetadata
from fvs_schema.names import Digest
from fvs_schema.quantities import Count
from fvs_schema.videos import is_video
from fvs_service.errors import LimitExceededError, NotFoundError
from fvs_service.images.upload_files import Hash, Receiver, Room, StagedFile, Writer, file_digest, too_large
from fvs_service.storage.blobs import full_disk_as_error

_ID = re.compile(r"upl_scn_[0-9a-z]+_[0-9a-f]{64}_[0-9]{1,18}")
_DESCRIPTION, _BYTES = ".json", ".part"

_log = structlog.get_logger()


class Upload(Model):
    """The image that an upload sends."""

    tenant_id: str
    scene_id: str
    digest: Digest
    size_bytes: Count
    metadata: ImageMetadata
    declared: str = ""
    """The metadata as the client has written them (tus)."""

    @property
    def id(self) -> str:
        """Names the upload; others of the same image have the same id."""
        return f"{_of_image(self.scene_id, self.digest)}_{self.size_bytes}"


class PartialUpload(Model):
    """How far an upload has come."""

    scene_id: str
    digest: Digest
    size_bytes: Count
    offset_bytes: Count
    """Number of bytes received."""
    expires_at: Timestamp
    """When it is deleted unless more bytes arrive."""


class Uploads:
    """The folder of uploads; a tenant may have ``per_tenant`` unfinished ones, each for ``keep_s``.

    When a tenant has that many, a new one replaces the smallest of those that have received nothing for
    ``spared_s``.
    """

    def __init__(
        self,
        folder: Path,
        *,
        keep_s: float,
        per_tenant: int,
        spared_s: float,
        reserve_bytes: int,
        max_bytes: int,
        max_video_bytes: int,
    ) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._max_bytes, self._max_video_bytes = folder, max_bytes, max_video_bytes
        self._keep_s, self._per_tenant, self._spared_s = keep_s, per_tenant, spared_s
        self._room = Room(folder, reserve_bytes)
        self._lock = threading.Lock()
        self._open: set[Path] = set()

    def require_room(self, upload: Upload) -> None:
        """Raise unless all of the upload may still arrive: ``PayloadTooLargeError``, ``OutOfSpaceError``."""
        self._require_size(upload)
        awaited = upload.size_bytes - (self.arrived_bytes(upload) or 0)
        with self._room.kept(lambda: awaited):
            pass

    def create(self, upload: Upload, *, finished: bool = False) -> None:
        """Create an upload, or give the one that exists another description; the bytes of it stay.

        ``finished``: the scene has the image, so no bytes are to come. Raises ``LimitExceededError``.
        """
        if finished:
            self.discard_bytes(upload)
        else:
            self._begin(upload)
        description = self._part(upload).with_suffix(_DESCRIPTION)
        with full_disk_as_error():
            description.parent.mkdir(exist_ok=True)
            write_text_atomically(description, upload.model_dump_json())

    def find(self, tenant_id: str, upload_id: str) -> Upload:
        """An upload of the tenant that was created; raises ``NotFoundError``."""
        if _ID.fullmatch(upload_id):
            path = self._tenant(tenant_id) / f"{upload_id}{_DESCRIPTION}"
            with contextlib.suppress(FileNotFoundError, ValidationError):  # a power cut may leave half of it
                upload = Upload.model_validate_json(path.read_bytes())
                if time.time() < self._expires_at(self._part(upload)):
                    return upload
        raise unknown_upload()

    def find_part(self, tenant_id: str, scene_id: str, digest: str) -> PartialUpload:
        """What has arrived of an image; raises ``NotFoundError``."""
        parts = self._tenant(tenant_id).glob(f"{_of_image(scene_id, digest)}_*{_BYTES}")
        for part in sorted(parts, key=_changed, reverse=True):
            offset, expires_at = _size(part), self._expires_at(part)
            if offset and time.time() < expires_at:
                return PartialUpload(
                    scene_id=scene_id,
                    digest=digest,
                    size_bytes=int(part.stem.rpartition("_")[2]),
                    offset_bytes=offset,
                    expires_at=datetime.fromtimestamp(expires_at, UTC),
                )
        raise NotFoundError("There is no partial upload of this image.", hint="Send it from its first byte.")

    def arrived_bytes(self, upload: Upload) -> int | None:
        """Number of bytes that have arrived; None when the upload is finished, deleted, or not yet there."""
        try:
            return self._part(upload).stat().st_size
        except FileNotFoundError:
            return None

    def expires_at(self, upload: Upload) -> datetime:
        """When the upload is deleted unless more bytes arrive."""
        return datetime.fromtimestamp(self._expires_at(self._part(upload)), UTC)

    @contextlib.contextmanager
    def writer(
        self, upload: Upload, offset: int, hashed: Hash | None = None, *, begin: bool = False
    ) -> Iterator[Writer]:
        """Write to the upload from ``offset`` on; the new bytes are added to ``hashed``.

        One block at a time may do so for an upload (see ``UploadLocks``). ``begin``: the upload need not
        exist. Raises ``OutOfSpaceError`` unless there is room for the rest, ``NotFoundError`` when the upload
        has been deleted, and what ``create`` does.
        """
        part = self._part(upload)
        with self._kept(part):
            if begin:
                self._begin(upload)
            try:
                writer = Writer(part, upload.size_bytes, offset, hashed)
            except FileNotFoundError:
                raise unknown_upload() from None
            try:
                with self._room.kept(lambda: writer.awaited_bytes):
                    yield writer
            finally:
                writer.close()
                if upload.size_bytes and not _size(part) and not part.with_suffix(_DESCRIPTION).exists():
                    part.unlink(missing_ok=True)

    @contextlib.contextmanager
    def staged(self, upload: Upload, digest: str | None = None) -> Iterator[StagedFile]:
        """The file of an upload whose bytes have all arrived; unless the block raises, it is then deleted.

        ``digest`` is that of the bytes, if it is known; else they are read.
        """
        part = self._part(upload)
        with self._kept(part):
            yield StagedFile(part, digest or file_digest(part), upload.size_bytes)
            part.unlink(missing_ok=True)

    def receive(self) -> Receiver:
        """Receive an image whose digest or size is not declared; raises ``OutOfSpaceError``."""
        return Receiver(self._folder / f"{uuid4().hex}{_BYTES}", self._max_bytes, self._room)

    def discard_bytes(self, upload: Upload) -> None:
        """Delete the bytes of an upload that needs none: the scene has the image."""
        self._part(upload).unlink(missing_ok=True)

    def remove(self, upload: Upload) -> None:
        """Delete the upload and its bytes."""
        _remove(self._part(upload))

    def remove_scene(self, tenant_id: str, scene_id: str) -> None:
        """Delete the uploads of a deleted scene; what a running request still writes is lost."""
        for path in self._tenant(tenant_id).glob(f"upl_{scene_id}_*"):
            with contextlib.suppress(OSError):  # what stays expires
                path.unlink(missing_ok=True)

    def clear(self) -> None:
        """Delete the files of ``receive`` that a killed gateway left; only while there is no upload."""
        for path in self._folder.glob(f"*{_BYTES}"):
            path.unlink(missing_ok=True)

    async def prune_regularly(self, every_s: float) -> None:
        """Delete uploads that have expired, until cancelled."""
        while True:
            try:
                await anyio.to_thread.run_sync(self.prune)
            except OSError as error:
                _log.warning("uploads cannot be deleted", reason=str(error))
            await asyncio.sleep(every_s)

    def prune(self) -> None:
        """Delete uploads that have expired."""
        for tenant in self._folder.glob("*/"):
            parts = {path.with_suffix(_BYTES) for path in tenant.glob("upl_*")}
            for part in parts:
                with self._lock:
                    if part not in self._open and self._expires_at(part) <= time.time():
                        _remove(part)

    def _begin(self, upload: Upload) -> None:
        """Make the file of an upload, unless there is one."""
        self._require_size(upload)
        part = self._part(upload)
        with self._lock, full_disk_as_error():
            part.parent.mkdir(exist_ok=True)
            if not part.exists():
                self._make_room(part.parent)
                part.touch()

    def _require_size(self, upload: Upload) -> None:
        limit = self._max_video_bytes if is_video(upload.metadata.name or "") else self._max_bytes
        if upload.size_bytes > limit:
            raise too_large(limit)

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
        _remove(min((path for path, left_s in spared_s.items() if left_s <= 0), key=_size))

    def _left_s(self, part: Path) -> float:
        """Time for which an upload is still spared, never more than ``spared_s``."""
        left_s = _changed(part) + self._spared_s - time.time()
        # A later time means that the clock was set back after the write; its age is unknown.
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

    def _expires_at(self, part: Path) -> float:
        return max(_changed(part), _changed(part.with_suffix(_DESCRIPTION))) + self._keep_s

    def _part(self, upload: Upload) -> Path:
        return self._tenant(upload.tenant_id) / f"{upload.id}{_BYTES}"

    def _tenant(self, tenant_id: str) -> Path:
        return self._folder / hashlib.sha256(tenant_id.encode()).hexdigest()[:16]


def unknown_upload() -> NotFoundError:
    """The error for an upload that does not exist, has expired, or belongs to others."""
    return NotFoundError(
        "There is no such upload.",
        hint="It may have expired. Create it again: POST /v1/uploads returns its offset.",
    )


def _of_image(scene_id: str, digest: str) -> str:
    return f"upl_{scene_id}_{digest.removeprefix('sha256:')}"


def _remove(part: Path) -> None:
    part.with_suffix(_DESCRIPTION).unlink(missing_ok=True)
    part.unlink(missing_ok=True)


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
