# Generated from _async/downloading.py by `make generate`. Do not edit.
"""Download artifacts and original images: resumed after a broken connection, verified by digest."""

import hashlib
import time
from collections.abc import Callable
from pathlib import Path

from fvs_client import requests
from fvs_client._sync.concurrency import run_blocking, sleep
from fvs_client._sync.session import Session
from fvs_client.downloads import DownloadProgress, Part, damaged
from fvs_client.errors import ApiError, ConnectionFailedError, FvsError
from fvs_schema.snapshots import Artifact

_RANGE_NOT_SATISFIABLE = 416


def download(
    session: Session,
    path: str,
    artifact: Artifact,
    target: Path,
    on_progress: Callable[[DownloadProgress], object] | None,
) -> Path:
    """Write the artifact, which the service has at ``path``, to ``target`` and return it.

    An interrupted download resumes where it ended, also in another process. ``target`` appears complete and
    verified, or not at all; nothing is downloaded when it is the artifact already. Raises
    ``DamagedDownloadError``.
    """
    part = Part(artifact, target)
    if run_blocking(part.target_is_current):
        return target
    target.parent.mkdir(parents=True, exist_ok=True)
    began, attempt = time.monotonic(), 0
    while True:
        attempt += 1
        had = part.size_bytes
        try:
            _fetch(session, path, part, on_progress)
            break
        except FvsError as error:
            if part.size_bytes > had:
                began, attempt = time.monotonic(), 1  # retries count only attempts that bring nothing
            pause = session.retries.pause_s(error, attempt, time.monotonic() - began)
            if pause is None:
                raise
        sleep(pause)
    run_blocking(part.finish)
    return target


def read(session: Session, path: str, artifact: Artifact) -> bytes:
    """The content of a small artifact, verified; raises ``DamagedDownloadError``."""
    content = session.content(requests.read_content(path))
    if hashlib.sha256(content).hexdigest() != artifact.sha256:
        raise damaged(artifact, hint="Try again.")
    return content


def _fetch(
    session: Session,
    path: str,
    part: Part,
    on_progress: Callable[[DownloadProgress], object] | None,
) -> None:
    """Append to ``part`` what is missing."""
    if part.whole:
        return
    artifact = part.artifact
    if part.size_bytes > artifact.size_bytes:
        part.discard()
    start = part.size_bytes
    request = requests.read_content(path, start, f'"{artifact.sha256}"')
    try:
        with session.open(request) as response:
            resumed = response.status_code == 206 and response.headers.get("content-range", "").startswith(
                f"bytes {start}-"
            )
            done = start if resumed else 0
            with part.path.open("ab" if resumed else "wb") as file:
                for chunk in response.iter_raw():
                    run_blocking(file.write, chunk)
                    done += len(chunk)
                    if on_progress is not None:
                        on_progress(DownloadProgress(artifact.name, done, artifact.size_bytes))
    except ApiError as error:
        if error.status == _RANGE_NOT_SATISFIABLE:
            part.discard()
        raise
    if done < artifact.size_bytes:
        raise ConnectionFailedError(f"{artifact.name} ended after {done:,} of {artifact.size_bytes:,} bytes.")
