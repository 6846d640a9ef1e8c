"""The storage and the services, opened together for the gateway and the workers."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from fvs_service.auth import Keys
from fvs_service.deletion.service import Deletions
from fvs_service.images.exclusion import Exclusions
from fvs_service.images.fair_turns import FairTurns
from fvs_service.images.inspector import Inspector
from fvs_service.images.partial_uploads import PartialUploads
from fvs_service.images.service import Images
from fvs_service.images.staging import StagingArea
from fvs_service.images.upload_places import UploadPlaces
from fvs_service.jobs.ledger import Ledger
from fvs_service.jobs.queue import JobQueue
from fvs_service.jobs.service import Jobs
from fvs_service.jobs.work import work_of
from fvs_service.rankings.port import SceneRunners
from fvs_service.rankings.service import Rankings
from fvs_service.scenes.lease import Leases
from fvs_service.scenes.service import Scenes
from fvs_service.settings import Settings
from fvs_service.snapshots.service import Snapshots
from fvs_service.storage.blobs import Blobs, require_room
from fvs_service.storage.database import Database
from fvs_service.storage.removals import Removals
from fvs_service.tracing import Tracing


@dataclass(frozen=True)
class Storage:
    """The database, the blobs and the services on them that gateways and workers share."""

    settings: Settings
    database: Database
    blobs: Blobs
    keys: Keys
    leases: Leases
    ledger: Ledger
    queue: JobQueue
    snapshots: Snapshots
    removals: Removals
    tracing: Tracing


@dataclass(frozen=True)
class Application:
    """The storage and all services, for a gateway."""

    storage: Storage
    runners: SceneRunners
    staging: StagingArea
    partial_uploads: PartialUploads
    upload_places: UploadPlaces
    inspection_turns: FairTurns
    scenes: Scenes
    images: Images
    exclusions: Exclusions
    jobs: Jobs
    rankings: Rankings
    deletions: Deletions


MakeRunners = Callable[[Storage], SceneRunners]
"""Makes the client of the runners for a storage."""


@contextmanager
def open_storage(settings: Settings, tracing: Tracing | None = None) -> Iterator[Storage]:
    """Open the database, after migrating its schema, and the blobs; close them at the end."""
    settings.root.mkdir(parents=True, exist_ok=True)
    database = Database(settings.database)
    try:
        database.migrate()
        blobs = Blobs(settings.root / "blobs", settings.blobs)
        yield Storage(
            settings=settings,
            database=database,
            blobs=blobs,
            keys=Keys(database, required=settings.keys_required),
            leases=Leases(database, settings.lease_s),
            ledger=Ledger(database),
            queue=JobQueue(
                database,
                jobs_per_tenant=settings.limits.running_jobs_per_tenant,
                turn_s=settings.worker.turn_s,
                does=work_of(settings.worker.work),
            ),
            snapshots=Snapshots(database, blobs),
            removals=Removals(database, blobs, settings.removal_grace_s),
            tracing=tracing or Tracing(),
        )
    finally:
        database.close()


def _require_room_for_rankings(settings: Settings) -> None:
    """Raise ``OutOfSpaceError`` when free disk space has fallen to half of the reserve.

    A mission continues with rankings when uploads are refused; the other half is for jobs that end and for
    deletions.
    """
    if settings.on_one_machine:
        require_room(settings.root, 0, settings.reserve_bytes // 2)


@contextmanager
def open_application(
    settings: Settings, make_runners: MakeRunners, tracing: Tracing | None = None
) -> Iterator[Application]:
    """Open the storage and the services on top of it."""
    limits = settings.limits
    with open_storage(settings, tracing) as storage:
        inspector = Inspector(
            limits.of_images,
            children=settings.inspectors,
            cpu_s=settings.inspection_s,
            memory_bytes=settings.inspection_bytes,
        )
        try:
            jobs = Jobs(storage.database, storage.queue, limits)
            runners = make_runners(storage)
            yield Application(
                storage=storage,
                runners=runners,
                staging=StagingArea(
                    settings.staging, reserve_bytes=settings.reserve_bytes, max_bytes=limits.image_bytes
                ),
                partial_uploads=PartialUploads(
                    settings.partial_uploads,
                    keep_s=settings.partial_upload_s,
                    per_tenant=limits.open_uploads_per_tenant,
                ),
                # One more than inspectors: it is ready when the next one is.
                inspection_turns=FairTurns(settings.inspectors + 1),
                upload_places=UploadPlaces(
                    limits.open_uploads_per_tenant,
                    grace_s=settings.upload_grace_s,
                    hold_s=settings.upload_place_s,
                ),
                scenes=Scenes(storage.database, limits),
                images=Images(storage.database, storage.blobs, inspector, jobs, limits),
                exclusions=Exclusions(storage.database, jobs),
                jobs=jobs,
                rankings=Rankings(
                    storage.database,
                    storage.blobs,
                    storage.snapshots,
                    runners,
                    limits,
                    lambda: _require_room_for_rankings(settings),
                ),
                deletions=Deletions(storage.database, settings.removal_grace_s),
            )
        finally:
            inspector.close()
