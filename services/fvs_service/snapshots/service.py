"""The operations on snapshots: return them, read their artifacts and, for workers, commit them."""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

from sqlalchemy.orm import Session

from fvs_engine.wording import notice
from fvs_schema.artifacts import ALIGNMENT, CAMERAS, COLMAP, GAUSSIANS, TERRAIN
from fvs_schema.base import Page
from fvs_schema.control_points import ControlResiduals
from fvs_schema.events import EventKind
from fvs_schema.findings import Finding, FindingCode, Severity
from fvs_schema.jobs import Job, JobKind
from fvs_schema.scenes import Alignment
from fvs_schema.snapshots import (
    Artifact,
    Snapshot,
    SnapshotCameras,
    SnapshotChange,
    SnapshotList,
    SnapshotMetrics,
)
from fvs_schema.terrain import Terrain
from fvs_service.errors import NotFoundError
from fvs_service.events.repository import publish
from fvs_service.ids import new_id
from fvs_service.images.repository import register
from fvs_service.jobs.ledger import add_warning, attach_snapshot, record_milestone
from fvs_service.jobs.repository import last_image_number
from fvs_service.principal import Principal, Scope
from fvs_service.scenes.lease import Lease, require_lease
from fvs_service.scenes.repository import find_scene_head, scene_of, set_snapshot
from fvs_service.snapshots import repository
from fvs_service.snapshots.artifacts import MEDIA_TYPES
from fvs_service.storage.blob_keys import artifact_key, manifest_key
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.removals import ABANDONED_AFTER, keep, lock_scene, remove_later
from fvs_service.storage.tables import JobMilestoneRow

_MODEL = frozenset({GAUSSIANS, COLMAP, ALIGNMENT})
"""The artifacts that make a model; the others repeat them in another order or form, or are about the job."""


@dataclass(frozen=True)
class NewSnapshot:
    """A snapshot to commit: ``files`` are files on the worker's disk by artifact name.

    ``registered`` and ``unregistered`` have the digests of the images that the job processed; the latter with
    the reasons, which may be empty.
    """

    metrics: SnapshotMetrics
    alignment: Alignment
    files: Mapping[str, Path]
    registered: Iterable[str]
    unregistered: Mapping[str, Finding | None]
    control: ControlResiduals | None = None


class Snapshots:
    """Returns, reads and commits snapshots."""

    def __init__(self, database: Database, blobs: Blobs) -> None:
        self._database = database
        self._blobs = blobs

    def require(self, principal: Principal, scope: Scope, snapshot_id: str) -> None:
        """Raise ``ForbiddenError`` without the scope, ``NotFoundError`` when there is no such snapshot."""
        principal.require(scope, principal.scene_id)
        with self._database.reading() as session:
            repository.snapshot_of(session, principal, snapshot_id)

    def get(self, principal: Principal, snapshot_id: str) -> Snapshot:
        """One snapshot; raises ``NotFoundError``."""
        principal.require(Scope.READ, principal.scene_id)
        with self._database.reading() as session:
            return repository.snapshot_of(session, principal, snapshot_id)

    def of_scene(self, principal: Principal, scene_id: str, page: Page) -> SnapshotList:
        """The snapshots of a scene, the newest first; refuses a cursor of another list."""
        principal.require(Scope.READ, scene_id)
        with self._database.reading() as session:
            scene_of(session, principal, scene_id)
            return repository.snapshots_of_scene(session, scene_id, page)

    def artifact(self, principal: Principal, snapshot_id: str, name: str) -> Artifact:
        """One file of a snapshot; raises ``NotFoundError``."""
        for artifact in self.get(principal, snapshot_id).artifacts:
            if artifact.name == name:
                return artifact
        raise NotFoundError("The snapshot has no such artifact.", hint="The snapshot lists its artifacts.")

    def read(self, snapshot: Snapshot, name: str, start: int = 0, stop: int | None = None) -> Iterator[bytes]:
        """The bytes of an artifact, in chunks."""
        return self._blobs.chunks(_key(snapshot, name), start, stop)

    def cameras(self, snapshot: Snapshot) -> SnapshotCameras:
        """The poses of the snapshot's images."""
        return SnapshotCameras.model_validate_json(self._blobs.read(_key(snapshot, CAMERAS)))

    def terrain(self, snapshot: Snapshot) -> Terrain | None:
        """The ground by the snapshot's points; None where it has none."""
        if all(artifact.name != TERRAIN for artifact in snapshot.artifacts):
            return None
        return Terrain.model_validate_json(self._blobs.read(_key(snapshot, TERRAIN)))

    def change(self, principal: Principal, snapshot_id: str, change: SnapshotChange) -> Snapshot:
        """Pin or unpin a snapshot; raises ``NotFoundError``."""
        principal.require(Scope.OPERATE, principal.scene_id)
        with self._database.writing() as session:
            lock_scene(session, repository.snapshot_of(session, principal, snapshot_id).scene_id)
            repository.snapshot_of(session, principal, snapshot_id)
            repository.pin(session, snapshot_id, pinned=change.pinned)
            return repository.snapshot_of(session, principal, snapshot_id)

    def commit(self, lease: Lease, job: Job, milestone: str, made: NewSnapshot) -> Snapshot:
        """Add a snapshot and make it the scene's latest, atomically and once per job and milestone.

        The scene keeps its present snapshot if that has more registered images: it is from an update that ran
        while a fine model was trained, and rankings must use its images. An update that has changed nothing
        makes no snapshot: the earlier one with the same model is the job's.

        The artifacts are stored first, to be removed again unless a snapshot refers to them within an
        hour; the snapshot, its references, the scene's latest snapshot, the images' registrations and the
        milestone are one transaction that the lease's token fences. Raises ``StaleLeaseError``; then nothing
        has changed.
        """
        earlier = self._committed(job.id, milestone)
        if earlier is not None:
            return earlier
        artifacts = tuple(_artifact(name, file) for name, file in sorted(made.files.items()))
        if job.kind is JobKind.UPDATE:
            unchanged = self._commit_unchanged(lease, job, milestone, made, artifacts)
            if unchanged is not None:
                return unchanged
        snapshot = Snapshot(
            id=new_id("snp"),
            scene_id=lease.scene_id,
            job_id=job.id,
            kind=job.kind,
            metrics=made.metrics,
            alignment=made.alignment,
            control=made.control,
            artifacts=artifacts,
            created_at=now(),
        )
        keys = self._store(lease, snapshot, made.files)
        while not self._add(lease, job, milestone, made, snapshot, keys):
            keys = self._store(lease, snapshot, made.files)
        return snapshot

    def _store(self, lease: Lease, snapshot: Snapshot, files: Mapping[str, Path]) -> tuple[str, ...]:
        """Store the artifacts and their list; returns the blobs' keys."""
        stored = {_key(snapshot, name): file for name, file in files.items()}
        manifest = manifest_key(snapshot.scene_id, snapshot.id)
        with self._database.writing(lease.scene_id) as session:
            require_lease(session, lease)
            for key in (*stored, manifest):
                remove_later(session, snapshot.scene_id, key, after=ABANDONED_AFTER)
        for key, file in stored.items():
            self._blobs.keep(file, key)
        digests = {artifact.name: artifact.sha256 for artifact in snapshot.artifacts}
        self._blobs.put(json.dumps(digests).encode(), manifest)
        return (*stored, manifest)

    def _add(
        self,
        lease: Lease,
        job: Job,
        milestone: str,
        made: NewSnapshot,
        snapshot: Snapshot,
        keys: tuple[str, ...],
    ) -> bool:
        """Add a snapshot whose blobs are stored; False when one was removed in between, as unused."""
        with self._database.writing(lease.scene_id) as session:
            require_lease(session, lease)
            if not all(map(self._blobs.exists, keys)):
                return False
            repository.add_snapshot(session, snapshot)
            keep(session, keys)
            last = last_image_number(session, job.id, job.attempt)
            register(session, lease.scene_id, made.registered, made.unregistered, last)
            if not _is_behind(session, snapshot):
                set_snapshot(session, lease.scene_id, snapshot.id)
            attach_snapshot(session, job.id, snapshot.id)
            record_milestone(session, job.id, milestone, {"snapshot_id": snapshot.id})
            data = {
                "snapshot_id": snapshot.id,
                "job_id": job.id,
                "kind": job.kind.value,
                "metrics": made.metrics.model_dump(mode="json"),
                "alignment": made.alignment.model_dump(mode="json"),
            }
            publish(session, lease.scene_id, EventKind.SNAPSHOT_CREATED, data, subject=snapshot.id)
        return True

    def _commit_unchanged(
        self, lease: Lease, job: Job, milestone: str, made: NewSnapshot, artifacts: tuple[Artifact, ...]
    ) -> Snapshot | None:
        """Commit an update that ended with the model of an earlier snapshot, which is returned.

        When an update has made another model since, the earlier snapshot becomes the scene's latest again.
        """
        model = {item.name: item.sha256 for item in artifacts if item.name in _MODEL}
        with self._database.writing(lease.scene_id) as session:
            require_lease(session, lease)
            earlier = repository.with_artifacts(session, lease.scene_id, model)
            if earlier is None:
                return None
            last = last_image_number(session, job.id, job.attempt)
            register(session, lease.scene_id, made.registered, made.unregistered, last)
            attach_snapshot(session, job.id, earlier.id)
            record_milestone(session, job.id, milestone, {"snapshot_id": earlier.id})
            if earlier.id == repository.of_update_before(session, lease.scene_id, job.id):
                unchanged = Finding.of(
                    FindingCode.UPDATE_UNCHANGED, severity=Severity.NOTE, snapshot=earlier.id
                )
                add_warning(session, job.id, notice(unchanged))
            else:
                set_snapshot(session, lease.scene_id, earlier.id)
        return earlier

    def _committed(self, job_id: str, milestone: str) -> Snapshot | None:
        with self._database.reading() as session:
            row = session.get(JobMilestoneRow, (job_id, milestone))
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


def _key(snapshot: Snapshot, name: str) -> str:
    digest = next(artifact.sha256 for artifact in snapshot.artifacts if artifact.name == name)
    return artifact_key(snapshot.scene_id, digest)


def _artifact(name: str, file: Path) -> Artifact:
    with file.open("rb") as content:
        digest = hashlib.file_digest(content, "sha256").hexdigest()
    media_type = MEDIA_TYPES.get(file.suffix, "application/octet-stream")
    return Artifact(name=name, media_type=media_type, size_bytes=file.stat().st_size, sha256=digest)
