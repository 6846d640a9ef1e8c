"""The operations on snapshots: return them, read their artifacts and, for workers, commit them."""

import hashlib
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy.orm import Session

from fvs_service.errors import NotFoundError
from fvs_service.events.model import EventKind
from fvs_service.events.repository import publish
from fvs_service.ids import new_id
from fvs_service.images.repository import register
from fvs_service.jobs.ledger import attach_snapshot, record_stage
from fvs_service.jobs.model import Job, JobKind
from fvs_service.model import Page, now
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.lease import Lease, require_lease
from fvs_service.scenes.model import Alignment
from fvs_service.scenes.repository import find_scene_head, scene_of, set_snapshot
from fvs_service.snapshots import repository
from fvs_service.snapshots.model import (
    MEDIA_TYPES,
    Artifact,
    Snapshot,
    SnapshotCameras,
    SnapshotList,
    SnapshotMetrics,
)
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.database import Database
from fvs_service.storage.tables import JobStageRow

CAMERAS = "cameras.json"
"""The artifact with the ``SnapshotCameras``; every snapshot has it."""
GAUSSIANS = "point_cloud.ply"
"""The artifact with the Gaussians in the layout of 3DGS; every snapshot has it."""


@dataclass(frozen=True)
class NewSnapshot:
    """A snapshot to commit: ``files`` are files on the worker's disk by artifact name; they are moved.

    ``registered`` and ``unregistered`` are the digests of the images that the job processed.
    """

    metrics: SnapshotMetrics
    alignment: Alignment
    files: Mapping[str, Path]
    registered: Iterable[str]
    unregistered: Iterable[str]


class Snapshots:
    """Returns, reads and commits snapshots."""

    def __init__(self, database: Database, blobs: Blobs) -> None:
        self._database = database
        self._blobs = blobs

    def get(self, principal: Principal, snapshot_id: str) -> Snapshot:
        """One snapshot; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return repository.snapshot_of(session, principal, snapshot_id)

    def of_scene(self, principal: Principal, scene_id: str, page: Page) -> SnapshotList:
        """The snapshots of a scene, the oldest first."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_of(session, principal, scene_id)
            found = repository.snapshots_of_scene(session, scene_id, page.after, page.limit + 1)
        return SnapshotList.of(found, page.limit, lambda snapshot: snapshot.id)

    def artifact(self, principal: Principal, snapshot_id: str, name: str) -> Artifact:
        """One file of a snapshot; raises ``NotFoundError``."""
        for artifact in self.get(principal, snapshot_id).artifacts:
            if artifact.name == name:
                return artifact
        raise NotFoundError("The snapshot has no such artifact.", hint="The snapshot lists its artifacts.")

    def read(self, snapshot: Snapshot, name: str, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes of an artifact, in chunks."""
        return self._blobs.chunks(artifact_key(snapshot.scene_id, snapshot.id, name), start, stop)

    def cameras(self, snapshot: Snapshot) -> SnapshotCameras:
        """The poses of the snapshot's images."""
        return SnapshotCameras.model_validate_json(
            self._blobs.read(artifact_key(snapshot.scene_id, snapshot.id, CAMERAS))
        )

    def commit(self, lease: Lease, job: Job, stage: str, made: NewSnapshot) -> Snapshot:
        """Add a snapshot and make it the scene's latest, atomically and once per job and stage.

        The scene keeps its present snapshot if that has more registered images: it is from an update that ran
        while a fine model was trained, and rankings must use its images.

        The artifacts are stored first; the snapshot, the scene's latest snapshot, the images' registrations
        and the stage are one transaction that the lease's token fences. Raises ``StaleLeaseError``; then
        nothing has changed.
        """
        earlier = self._committed(job.id, stage)
        if earlier is not None:
            return earlier
        snapshot_id = new_id("snp")
        artifacts = []
        for name, file in sorted(made.files.items()):
            size, digest = _measure(file)
            media_type = MEDIA_TYPES.get(Path(name).suffix, "application/octet-stream")
            artifacts.append(Artifact(name=name, media_type=media_type, size_bytes=size, sha256=digest))
            self._blobs.adopt(file, artifact_key(lease.scene_id, snapshot_id, name))
        snapshot = Snapshot(
            id=snapshot_id,
            scene_id=lease.scene_id,
            job_id=job.id,
            kind=job.kind,
            metrics=made.metrics,
            alignment=made.alignment,
            artifacts=tuple(artifacts),
            created_at=now(),
        )
        with self._database.writing() as session:
            require_lease(session, lease)
            repository.add_snapshot(session, snapshot)
            register(session, lease.scene_id, made.registered, made.unregistered)
            if not _is_behind(session, snapshot):
                set_snapshot(session, lease.scene_id, snapshot_id)
            attach_snapshot(session, job.id, snapshot_id)
            record_stage(session, job.id, stage, {"snapshot_id": snapshot_id})
            data = {
                "snapshot_id": snapshot_id,
                "job_id": job.id,
                "metrics": made.metrics.model_dump(mode="json"),
                "alignment": made.alignment.model_dump(mode="json"),
            }
            publish(session, lease.scene_id, EventKind.SNAPSHOT_CREATED, data, subject=snapshot_id)
        return snapshot

    def _committed(self, job_id: str, stage: str) -> Snapshot | None:
        with self._database.reading() as session:
            row = session.get(JobStageRow, (job_id, stage))
            if row is None:
                return None
            return repository.find_snapshot(session, row.document["snapshot_id"])


def _is_behind(session: Session, snapshot: Snapshot) -> bool:
    """Whether a fine model has fewer registered images than the scene's present snapshot."""
    if snapshot.kind is not JobKind.FINE:
        return False
    present = find_scene_head(session, snapshot.scene_id).snapshot_id
    if present is None:
        return False
    return repository.find_snapshot(session, present).metrics.registered > snapshot.metrics.registered


def artifact_key(scene_id: str, snapshot_id: str, name: str) -> str:
    """The blob key of an artifact."""
    return f"scenes/{scene_id}/snapshots/{snapshot_id}/{name}"


def _measure(file: Path) -> tuple[int, str]:
    with file.open("rb") as content:
        return file.stat().st_size, hashlib.file_digest(content, "sha256").hexdigest()
