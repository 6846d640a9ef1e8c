"""Partial uploads: the bytes of a broken upload are kept for a while, and another upload can resume them.

A partial upload is a file whose name has the tenant, the scene and the image; its length is the offset to
resume at, and the time that it is kept counts from its last change. Each belongs to a tenant. Resuming takes
the file away, so that only one upload at a time continues it. The file of an upload in progress begins with
the same name: a gateway that was killed keeps what had arrived when it starts again. Bytes that a power cut
has damaged are found by the image's digest.
"""

import contextlib
import hashlib
import time
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

import structlog

from fvs_schema.base import Model, Timestamp
from fvs_schema.names import Digest
from fvs_schema.quantities import Count
from fvs_service.errors import ConflictError, NotFoundError

_SUFFIX = ".part"

_log = structlog.get_logger()


class NewUpload(Model):
    """The image that an upload sends, and where in it the upload begins."""

    scene_id: str
    digest: Digest
    size_bytes: Count = 0
    offset_bytes: Count = 0


class Upload(Model):
    """An upload that broke off."""

    scene_id: str
    digest: Digest
    size_bytes: Count
    offset_bytes: Count
    """Number of bytes received."""
    expires_at: Timestamp
    """When it is deleted unless more bytes arrive."""


@dataclass(frozen=True)
class PartialUploads:
    """The folder of partial uploads: of each tenant the largest ``per_tenant``, each for ``keep_s``."""

    folder: Path
    keep_s: float
    per_tenant: int

    def find(self, tenant_id: str, scene_id: str, digest: str) -> Upload:
        """The partial upload of an image; raises ``NotFoundError``."""
        for path in self._of(f"{_tenant(tenant_id)}-{scene_id}-{_hex(digest)}-"):
            try:
                changed = path.stat()
            except FileNotFoundError:  # taken or replaced meanwhile
                continue
            if changed.st_mtime + self.keep_s > time.time():
                return Upload(
                    scene_id=scene_id,
                    digest=digest,
                    size_bytes=int(path.stem.rpartition("-")[2]),
                    offset_bytes=changed.st_size,
                    expires_at=datetime.fromtimestamp(changed.st_mtime + self.keep_s, UTC),
                )
        raise NotFoundError("There is no partial upload of this image.", hint="Send it from its first byte.")

    def take(self, tenant_id: str, new: NewUpload, to: Path) -> None:
        """Move the bytes before ``new.offset_bytes`` to ``to``.

        Raises ``ConflictError`` when these are not the bytes that have arrived.
        """
        path = self._path(tenant_id, new)
        try:
            arrived = path.stat().st_size
            if arrived == new.offset_bytes:
                path.replace(to)
                return
        except FileNotFoundError:
            arrived = 0
        raise ConflictError(
            f"{arrived} bytes of the image have arrived, not {new.offset_bytes}.",
            hint="GetUpload returns the offset to resume at; if it finds none, send the whole image.",
        )

    def keep(self, tenant_id: str, new: NewUpload, part: Path) -> None:
        """Keep the bytes of an upload that broke off, unless more are kept, or the image is stored."""
        self._keep(part, self._path(tenant_id, new))

    def recover(self, staging: Path) -> None:
        """Keep what had arrived of uploads when a gateway was killed: their files in ``staging``.

        Only while there is no upload. What cannot be kept, as on a full disk, is logged: the caller frees it.
        """
        for part in staging.glob(f"*{_SUFFIX}.*"):
            try:
                self._keep(part, self.folder / f"{part.name.partition(_SUFFIX)[0]}{_SUFFIX}")
            except OSError as error:
                _log.warning("an upload cannot be kept", reason=str(error))

    def name(self, tenant_id: str, new: NewUpload) -> str:
        """The name of the partial upload's file."""
        return f"{_tenant(tenant_id)}-{new.scene_id}-{_hex(new.digest)}-{new.size_bytes}{_SUFFIX}"

    def prune(self) -> None:
        """Delete those that have expired."""
        for path in self.folder.glob(f"*{_SUFFIX}"):
            if _changed(path) + self.keep_s <= time.time():
                path.unlink(missing_ok=True)

    def _keep(self, part: Path, kept: Path) -> None:
        kept.parent.mkdir(parents=True, exist_ok=True)
        with contextlib.suppress(FileNotFoundError):
            size = part.stat().st_size
            if size and _size(kept) <= size:
                part.replace(kept)
        self.prune()
        # The largest stay: one key of a tenant cannot replace those of another with a few bytes each.
        theirs = sorted(self._of(f"{kept.name.partition('-')[0]}-"), key=_size, reverse=True)
        for path in theirs[self.per_tenant :]:
            path.unlink(missing_ok=True)

    def _of(self, prefix: str) -> list[Path]:
        """The partial uploads whose names begin with ``prefix``, the newest first."""
        return sorted(self.folder.glob(f"{prefix}*{_SUFFIX}"), key=_changed, reverse=True)

    def _path(self, tenant_id: str, new: NewUpload) -> Path:
        return self.folder / self.name(tenant_id, new)


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


def _tenant(tenant_id: str) -> str:
    return hashlib.sha256(tenant_id.encode()).hexdigest()[:16]


def _hex(digest: str) -> str:
    return digest.removeprefix("sha256:")
