"""Files of snapshots, downloaded so that a broken connection costs little and a damaged byte is noticed."""

import hashlib
import os
import time
from collections.abc import Callable
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path
from typing import IO

from fvs_client import requests
from fvs_client.effects import Close, Operation, Sleep, call, read
from fvs_client.errors import (
    ApiError,
    ConnectionFailedError,
    DamagedDownloadError,
    FvsError,
    NotFoundError,
    Problem,
)
from fvs_client.exchange import exchange, opened
from fvs_client.models.snapshots import Artifact, SnapshotData
from fvs_client.retries import Retries

_READ_BYTES = 1 << 20
_RANGE_NOT_SATISFIABLE = 416


@dataclass(frozen=True)
class DownloadProgress:
    """How far a download is; ``bytes_done`` counts what was there from before."""

    name: str
    bytes_done: int
    bytes_total: int


def artifact_of(snapshot: SnapshotData, name: str) -> Artifact:
    """The file that is called ``name``; raises ``NotFoundError`` before anything is asked."""
    for artifact in snapshot.artifacts:
        if artifact.name == name:
            return artifact
    names = ", ".join(artifact.name for artifact in snapshot.artifacts) or "none"
    raise NotFoundError(
        Problem(
            status=404,
            code="not-found",
            detail=f"The snapshot has no file {name!r}.",
            hint=f"It has these: {names}.",
        )
    )


def target_of(path: str | PathLike[str], name: str) -> Path:
    """Where the file ``name`` goes: to ``path``, or into it when it is a folder or ends like one."""
    spelt = fspath(path)
    folder = spelt.endswith(("/", os.sep)) or Path(spelt).is_dir()
    return Path(spelt) / name if folder else Path(spelt)


def download(
    snapshot_id: str,
    artifact: Artifact,
    target: Path,
    on_progress: Callable[[DownloadProgress], object] | None,
    retries: Retries,
) -> Operation[Path]:
    """Write the artefact to ``target`` and return it.

    Bytes go to a hidden file beside it that bears the digest's beginning; an interrupted download goes on
    from there, now or in another process. ``target`` appears whole and verified, or not at all. A file that
    is there already and is the same is left as it is. Raises ``DamagedDownloadError``.
    """
    if (yield from call(lambda: _is_same(target, artifact))):
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    part = target.with_name(f".{target.name}.{artifact.sha256[:12]}.part")
    began, attempt = time.monotonic(), 0
    while True:
        attempt += 1
        had = _size(part)
        try:
            yield from _fetch(snapshot_id, artifact, part, on_progress)
            break
        except FvsError as error:
            if _size(part) > had:
                began, attempt = time.monotonic(), 1  # it moves: patience begins anew
            pause = retries.pause_s(error, attempt, time.monotonic() - began)
            if pause is None:
                raise
        yield Sleep(pause)
    yield from call(lambda: _finish(part, target, artifact))
    return target


def _fetch(
    snapshot_id: str,
    artifact: Artifact,
    part: Path,
    on_progress: Callable[[DownloadProgress], object] | None,
) -> Operation[None]:
    """Make ``part`` whole, from where it ends."""
    start = _size(part)
    if start > artifact.size_bytes:
        part.unlink()
        start = 0
    if start == artifact.size_bytes and start:
        return
    request = requests.read_artifact(snapshot_id, artifact.name, start, f'"{artifact.sha256}"')
    try:
        reply = yield from opened(request)
    except ApiError as error:
        if error.status == _RANGE_NOT_SATISFIABLE:
            part.unlink(missing_ok=True)
        raise
    goes_on = reply.status == 206 and reply.headers.get("content-range", "").startswith(f"bytes {start}-")
    done = start if goes_on else 0
    file: IO[bytes]
    with part.open("ab" if goes_on else "wb") as file:
        while (chunk := (yield from read(reply.stream))) is not None:
            yield from call(lambda chunk=chunk: file.write(chunk))  # type: ignore[misc]
            done += len(chunk)
            if on_progress is not None:
                on_progress(DownloadProgress(artifact.name, done, artifact.size_bytes))
    yield Close(reply.stream)
    if done < artifact.size_bytes:
        raise ConnectionFailedError(f"{artifact.name} ended after {done:,} of {artifact.size_bytes:,} bytes.")


def _finish(part: Path, target: Path, artifact: Artifact) -> None:
    if not _is_same(part, artifact):
        part.unlink()
        raise DamagedDownloadError(
            f"{artifact.name} arrived with other bytes than the service has.",
            hint="Download it again; what came has been deleted.",
            retryable=True,
        )
    with part.open("rb+") as file:
        os.fsync(file.fileno())
    part.replace(target)


def _is_same(path: Path, artifact: Artifact) -> bool:
    if _size(path) != artifact.size_bytes or not path.is_file():
        return False
    digest = hashlib.sha256()
    with path.open("rb") as file:
        while chunk := file.read(_READ_BYTES):
            digest.update(chunk)
    return digest.hexdigest() == artifact.sha256


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0


def contents(snapshot_id: str, artifact: Artifact, retries: Retries) -> Operation[bytes]:
    """A small artefact's bytes, verified."""
    reply = yield from exchange(requests.read_artifact(snapshot_id, artifact.name), retries)
    if hashlib.sha256(reply.content).hexdigest() != artifact.sha256:
        raise DamagedDownloadError(
            f"{artifact.name} arrived with other bytes than the service has.",
            hint="Ask again.",
            retryable=True,
        )
    return reply.content
