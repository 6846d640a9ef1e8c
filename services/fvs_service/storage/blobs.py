"""Blobs: immutable bytes, such as images, artifacts and renders.

A blob is written whole or not at all: under a temporary name, flushed to the disk, and renamed. The store is
a folder on one machine, or one of the object stores that obstore supports (S3 and others).
"""

import errno
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from uuid import uuid4

import obstore
from obstore.store import LocalStore, from_url

from fvs_engine.files.atomic import flush_to_disk
from fvs_service.errors import NotFoundError, OutOfSpaceError

_CHUNK_BYTES = 1 << 20
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


@dataclass(frozen=True)
class BlobInfo:
    """A blob's key and size."""

    key: str
    size_bytes: int


class Blobs:
    """Blobs by key (``scenes/scn_…/images/…``): written once, read in ranges."""

    def __init__(self, folder: Path, url: str | None = None) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self._folder = folder if url is None else None
        self._store = LocalStore(folder) if url is None else from_url(url)

    def adopt(self, file: Path, key: str) -> None:
        """Move ``file`` into the store under ``key``; on the store's own disk nothing is copied."""
        if self._folder is None:
            obstore.put(self._store, key, file)
            file.unlink()
            return
        target = self._folder / key
        with full_disk_as_error():
            if file.stat().st_dev != self._folder.stat().st_dev:
                copied = self._folder / f".{uuid4().hex}.partial"
                shutil.copyfile(file, copied)
                file.unlink()
                file = copied
            _make_folder(target.parent)
            flush_to_disk(file)
            file.replace(target)
            flush_to_disk(target.parent)

    def put(self, content: bytes, key: str) -> None:
        """Store ``content`` under ``key``."""
        if self._folder is None:
            obstore.put(self._store, key, content)
            return
        file = self._folder / f".{uuid4().hex}.partial"
        with full_disk_as_error():
            try:
                file.write_bytes(content)
                self.adopt(file, key)
            finally:
                file.unlink(missing_ok=True)

    def info(self, key: str) -> BlobInfo:
        """The blob's size; raises ``NotFoundError``."""
        try:
            return BlobInfo(key, obstore.head(self._store, key)["size"])
        except FileNotFoundError as error:
            raise NotFoundError("There is no such blob.") from error

    def chunks(self, key: str, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes from ``start`` up to ``stop``, in chunks; raises ``NotFoundError``."""
        end = self.info(key).size_bytes if stop is None else stop
        if end <= start:
            return
        found = obstore.get(self._store, key, options={"range": (start, end)})
        for chunk in found.stream(min_chunk_size=_CHUNK_BYTES):
            yield bytes(chunk)

    def read(self, key: str) -> bytes:
        """The whole blob; raises ``NotFoundError``."""
        return b"".join(self.chunks(key))

    def exists(self, key: str) -> bool:
        """Whether the blob is stored."""
        try:
            self.info(key)
        except NotFoundError:
            return False
        return True

    def export(self, key: str, file: Path) -> None:
        """Make the blob available as ``file``: a hard link where possible, else a copy."""
        file.parent.mkdir(parents=True, exist_ok=True)
        if self._folder is not None:
            try:
                file.hardlink_to(self._folder / key)
            except FileExistsError:
                return
            except FileNotFoundError as error:
                raise NotFoundError("There is no such blob.") from error
            except OSError:  # another file system, or one without hard links
                pass
            else:
                return
        partial = file.with_name(f".{file.name}.{uuid4().hex}.partial")
        with full_disk_as_error():
            try:
                with partial.open("wb") as out:
                    out.writelines(self.chunks(key))
                partial.replace(file)
            finally:
                partial.unlink(missing_ok=True)


def require_room(folder: Path, size_bytes: int, reserve_bytes: int) -> None:
    """Raise ``OutOfSpaceError`` unless ``size_bytes`` fit and ``reserve_bytes`` stay free."""
    free = shutil.disk_usage(folder).free
    if free < size_bytes + reserve_bytes:
        raise OutOfSpaceError(
            f"The disk has {free // 1_000_000} MB left, and {reserve_bytes // 1_000_000} MB are kept free.",
            hint="Free some space on the service's disk, then send it again.",
            retry_after_s=60,
        )


class full_disk_as_error:  # noqa: N801 - reads as a statement: with full_disk_as_error()
    """Turn an ``OSError`` that means a full disk into ``OutOfSpaceError``."""

    def __enter__(self) -> None:
        return None

    def __exit__(self, _kind: object, error: BaseException | None, _trace: object) -> None:
        if isinstance(error, OSError) and error.errno in _FULL:
            raise OutOfSpaceError(
                "The disk is full.",
                hint="Free some space, then send it again.",
                retry_after_s=60,
            ) from error


def _make_folder(folder: Path) -> None:
    """Create a folder that survives a crash: its parents are flushed too."""
    if folder.is_dir():
        return
    _make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    flush_to_disk(folder.parent)
