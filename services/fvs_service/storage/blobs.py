"""Blobs: immutable bytes, such as images, artifacts and renders.

A blob is written whole or not at all. The store is a folder on one machine, where that means under a
temporary name, flushed to the disk, and renamed; or, for several machines, a bucket in an object store.
"""

import errno
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path
from uuid import uuid4

import obstore
from obstore.exceptions import BaseError, PermissionDeniedError, UnauthenticatedError
from obstore.store import LocalStore, S3Store

from fvs_engine.files.atomic import flush_to_disk
from fvs_service.errors import (
    NotFoundError,
    OutOfSpaceError,
    StorageRefusedError,
    StorageUnavailableError,
)
from fvs_service.settings import BlobSettings

_CHUNK_BYTES = 1 << 20
_PARTIAL = ".partial"
_PROBE = "checks/rights"
"""The blob that ``check_rights`` stores and deletes."""
_CONNECT_S, _REQUEST_S = 5, 60
_RETRIES = 5
_RETRY_S = 8
"""How long a request is repeated while the store does not answer; less than a transaction may wait."""
_FULL = {errno.ENOSPC, errno.EDQUOT, errno.EFBIG}


@dataclass(frozen=True)
class BlobInfo:
    """A blob's key, its size and when it was written."""

    key: str
    size_bytes: int
    modified_at: datetime


class Blobs:
    """Blobs by key (``scenes/scn_…/images/…``): written once, read in ranges.

    Every method raises ``StorageUnavailableError`` when the object store cannot be reached or refuses.
    """

    def __init__(self, folder: Path, settings: BlobSettings | None = None) -> None:
        self._folder: Path | None = None
        self._store: LocalStore | S3Store
        if settings is not None and settings.url is not None:
            self._store = _bucket(settings.url, settings)
        else:
            folder.mkdir(parents=True, exist_ok=True)
            self._folder, self._store = folder, LocalStore(folder)

    @property
    def shared(self) -> bool:
        """Whether other machines read and write them, too."""
        return self._folder is None

    def check(self) -> None:
        """Raise ``StorageUnavailableError`` with the reason, when the store cannot be used."""
        if self._folder is not None and not self._folder.is_dir():
            raise StorageUnavailableError(
                f"The folder {self._folder} is gone.", hint="Mount its disk, or restore it.", retry_after_s=60
            )
        with _reachable():  # listing tells a missing bucket, and needs no blob
            next(iter(obstore.list(self._store, "scenes/", chunk_size=1)), None)

    def check_rights(self) -> None:
        """Store, find and delete a blob in the object store.

        Raises ``StorageRefusedError`` with what it refuses. A folder is not tried.
        """
        if self._folder is not None:
            return
        for what, request in (
            ("store", lambda: self.put(b"", _PROBE)),
            ("find", lambda: self.exists(_PROBE)),
            ("delete", lambda: self.remove(_PROBE)),
        ):
            try:
                request()
            except StorageRefusedError as error:
                raise StorageRefusedError(
                    f"The object store refuses to {what} blobs.",
                    hint="Give the service's credentials the rights to list, get, put and delete.",
                    retry_after_s=60,
                ) from error

    def adopt(self, file: Path, key: str) -> None:
        """Move ``file`` into the store under ``key``; on the store's own disk nothing is copied."""
        if self._folder is None:
            with _reachable():
                obstore.put(self._store, key, file)
            file.unlink()
            return
        target = self._folder / key
        with full_disk_as_error():
            if file.stat().st_dev != self._folder.stat().st_dev:
                copied = self._folder / f".{uuid4().hex}{_PARTIAL}"
                shutil.copyfile(file, copied)
                file.unlink()
                file = copied
            flush_to_disk(file)
            _make_folder(target.parent)
            try:
                file.replace(target)
            except FileNotFoundError:  # the folder was removed with its scene just now
                _make_folder(target.parent)
                file.replace(target)
            flush_to_disk(target.parent)

    def keep(self, file: Path, key: str) -> None:
        """Store the content of ``file``, which stays, under ``key``; no effect when the key is stored."""
        if self.exists(key):
            return
        if self._folder is None:
            with _reachable():
                obstore.put(self._store, key, file)
            return
        copied = self._folder / f".{uuid4().hex}{_PARTIAL}"
        with full_disk_as_error():
            try:
                shutil.copyfile(file, copied)  # not a link: who writes to the file must not change the blob
                self.adopt(copied, key)
            finally:
                copied.unlink(missing_ok=True)

    def put(self, content: bytes, key: str) -> None:
        """Store ``content`` under ``key``."""
        if self._folder is None:
            with _reachable():
                obstore.put(self._store, key, content)
            return
        file = self._folder / f".{uuid4().hex}{_PARTIAL}"
        with full_disk_as_error():
            try:
                file.write_bytes(content)
                self.adopt(file, key)
            finally:
                file.unlink(missing_ok=True)

    def info(self, key: str) -> BlobInfo:
        """The blob's size; raises ``NotFoundError``."""
        try:
            with _reachable():
                try:
                    found = obstore.head(self._store, key)
                except FileNotFoundError:
                    if self._folder is not None:
                        raise
                    # Only a response with a body says whether the blob or its whole bucket is missing.
                    found = obstore.get(self._store, key).meta
            return BlobInfo(key, found["size"], found["last_modified"])
        except FileNotFoundError as error:
            raise NotFoundError("There is no such blob.") from error

    def chunks(self, key: str, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes from ``start`` up to ``stop``, in chunks; raises ``NotFoundError``."""
        end = self.info(key).size_bytes if stop is None else stop
        if end <= start:
            return
        try:
            with _reachable():
                found = obstore.get(self._store, key, options={"range": (start, end)})
        except FileNotFoundError as error:
            raise NotFoundError("There is no such blob.") from error
        with _reachable():
            for chunk in found.stream(min_chunk_size=_CHUNK_BYTES):
                yield bytes(chunk)

    def read(self, key: str) -> bytes:
        """The whole blob; raises ``NotFoundError``."""
        return b"".join(self.chunks(key))

    def exists(self, key: str) -> bool:
        """Whether the blob is stored; raises ``StorageRefusedError`` when there is no bucket."""
        try:
            self.info(key)
        except NotFoundError:
            return False
        return True

    def remove(self, key: str) -> None:
        """Remove a blob; no effect when there is none."""
        if self._folder is not None:
            (self._folder / key).unlink(missing_ok=True)
            return
        with suppress(FileNotFoundError), _reachable():
            obstore.delete(self._store, key)

    def remove_below(self, prefix: str) -> None:
        """Remove all blobs whose keys start with ``prefix``, which ends with a slash."""
        if self._folder is not None:
            # What is written there meanwhile stays, and is found by the next removal.
            shutil.rmtree(self._folder / prefix, ignore_errors=True)
            return
        with _reachable():
            for batch in obstore.list(self._store, prefix):
                obstore.delete(self._store, [found["path"] for found in batch])

    def below(self, prefix: str) -> Iterator[BlobInfo]:
        """All blobs whose keys start with ``prefix``, which ends with a slash."""
        with _reachable():
            batches = iter(obstore.list(self._store, prefix))
        while True:
            with _reachable():
                batch = next(batches, None)
            if batch is None:
                return
            for found in batch:
                yield BlobInfo(found["path"], found["size"], found["last_modified"])

    def unfinished(self, before: datetime) -> tuple[Path, ...]:
        """Files of writes that a crash interrupted before that time."""
        if self._folder is None:
            return ()
        return tuple(
            file
            for file in self._folder.glob(f".*{_PARTIAL}")
            if (written := _modified_at(file)) is not None and written < before
        )

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


def _bucket(url: str, settings: BlobSettings) -> S3Store:
    given = {
        "endpoint": settings.endpoint,
        "region": settings.region,
        "access_key_id": settings.access_key_id,
        "secret_access_key": settings.secret_access_key,
    }
    return S3Store.from_url(
        url,
        config={name: value for name, value in given.items() if value is not None},  # type: ignore[arg-type]
        client_options={
            "allow_http": (settings.endpoint or "").startswith("http://"),
            "connect_timeout": f"{_CONNECT_S}s",
            "timeout": f"{_REQUEST_S}s",
        },
        retry_config={"max_retries": _RETRIES, "retry_timeout": timedelta(seconds=_RETRY_S)},
    )


@contextmanager
def _reachable() -> Iterator[None]:
    try:
        yield
    except (BaseError, FileNotFoundError) as error:
        message = str(error)
        if isinstance(error, FileNotFoundError) and "NoSuchBucket" not in message:
            raise
        if "RequestTimeTooSkewed" in message:
            raise StorageRefusedError(
                "The object store refuses requests because this machine's clock is wrong, or its own.",
                hint="Synchronise both (NTP).",
                retry_after_s=60,
            ) from error
        if isinstance(error, PermissionDeniedError | UnauthenticatedError) or "403 Forbidden" in message:
            raise StorageRefusedError(
                "The object store refuses the service's credentials.",
                hint="Check FVS_BLOBS__ACCESS_KEY_ID and FVS_BLOBS__SECRET_ACCESS_KEY, and their rights.",
                retry_after_s=60,
            ) from error
        if "NoSuchBucket" in message:
            raise StorageRefusedError(
                "The object store has no such bucket.",
                hint="Create it, or correct FVS_BLOBS__URL.",
                retry_after_s=60,
            ) from error
        raise StorageUnavailableError(
            "The object store cannot be reached.",
            hint="Try again soon. If the error persists, run fvs doctor, which reports the cause.",
            retry_after_s=5,
        ) from error


def free_bytes(folder: Path) -> int:
    """The room left on the disk of ``folder`` in bytes."""
    return shutil.disk_usage(folder).free


def require_room(folder: Path, size_bytes: int, reserve_bytes: int, promised_bytes: int = 0) -> None:
    """Raise ``OutOfSpaceError`` unless ``size_bytes`` fit and ``reserve_bytes`` stay free.

    ``promised_bytes`` are needed by others, who have begun to write.
    """
    free = free_bytes(folder)
    if free < size_bytes + reserve_bytes + promised_bytes:
        promised = f" Other uploads need {promised_bytes // 1_000_000} MB of it." if promised_bytes else ""
        raise OutOfSpaceError(
            f"The disk has {free // 1_000_000} MB free, and {reserve_bytes // 1_000_000} MB must stay free."
            f"{promised}",
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


def _modified_at(file: Path) -> datetime | None:
    """When a file was last written; None when it is gone."""
    try:
        return datetime.fromtimestamp(file.stat().st_mtime, UTC)
    except FileNotFoundError:
        return None


def _make_folder(folder: Path) -> None:
    """Create a folder that survives a crash: its parents are flushed too."""
    if folder.is_dir():
        return
    _make_folder(folder.parent)
    folder.mkdir(exist_ok=True)
    flush_to_disk(folder.parent)
