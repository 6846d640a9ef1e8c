"""Files on disk of a download: a hidden part file that is verified and then renamed."""

import hashlib
import os
from dataclasses import dataclass
from os import PathLike, fspath
from pathlib import Path

from fvs_client.errors import DamagedDownloadError, NotFoundError
from fvs_client.models.resources import SnapshotData
from fvs_schema.problems import Problem
from fvs_schema.snapshots import Artifact

_READ_BYTES = 1 << 20


@dataclass(frozen=True)
class DownloadProgress:
    """Progress of a download; ``bytes_done`` includes what an earlier one left."""

    name: str
    bytes_done: int
    bytes_total: int


def artifact_named(snapshot: SnapshotData, name: str) -> Artifact:
    """The artifact ``name``; raises ``NotFoundError`` without a request."""
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


def target_path(path: str | PathLike[str], name: str) -> Path:
    """Where the file ``name`` goes: to ``path``, or into it when it is a folder or ends with a slash."""
    text = fspath(path)
    folder = text.endswith(("/", os.sep)) or Path(text).is_dir()
    return Path(text) / name if folder else Path(text)


@dataclass(frozen=True)
class Part:
    """The hidden file beside ``target`` that holds what has arrived of an artifact.

    Its name has the beginning of the artifact's digest, so that a later process resumes the same download.
    """

    artifact: Artifact
    target: Path

    @property
    def path(self) -> Path:
        """The hidden file."""
        return self.target.with_name(f".{self.target.name}.{self.artifact.sha256[:12]}.part")

    @property
    def size_bytes(self) -> int:
        """Bytes that have arrived."""
        return _size(self.path)

    @property
    def whole(self) -> bool:
        """Whether all bytes have arrived."""
        return 0 < self.size_bytes == self.artifact.size_bytes

    def target_is_current(self) -> bool:
        """Whether ``target`` is the artifact already."""
        return _is_same(self.target, self.artifact)

    def discard(self) -> None:
        """Remove what has arrived."""
        self.path.unlink(missing_ok=True)

    def finish(self) -> None:
        """Verify what has arrived and rename it to ``target``; raises ``DamagedDownloadError``."""
        if not _is_same(self.path, self.artifact):
            self.discard()
            raise damaged(self.artifact, hint="Download it again; the damaged file was deleted.")
        with self.path.open("rb+") as file:
            os.fsync(file.fileno())
        self.path.replace(self.target)


def damaged(artifact: Artifact, *, hint: str) -> DamagedDownloadError:
    """The error for content whose digest is not the artifact's."""
    return DamagedDownloadError(
        f"The downloaded {artifact.name} differs from the service's.", hint=hint, retryable=True
    )


def _is_same(path: Path, artifact: Artifact) -> bool:
    if _size(path) != artifact.size_bytes or not path.is_file():
        return False
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest() == artifact.sha256


def _size(path: Path) -> int:
    return path.stat().st_size if path.is_file() else 0
