"""The storage and the services, opened together for the gateway and the workers."""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from functools import partial

from fvs_engine.files.storage import storage_errors
from fvs_service.auth import Keys
from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.deletion.service import Deletions
from fvs_service.errors import NotFoundError
from fvs_service.forecasts.service import Forecasts
from fvs_service.images.exclusion import Exclusions
from fvs_service.images.fair_turns import FairTurns
from fvs_service.images.inspection import image_limits
from fvs_service.images.inspector import Inspector
from fvs_service.images.masks import Masks
from fvs_service.images.service import Images
from fvs_service.images.upload_locks import UploadLocks
from fvs_service.images.upload_places import UploadPlaces
from fvs_service.images.uploads import Uploads
from fvs_service.images.videos import Videos
from fvs_service.jobs.ledger import Ledger
from fvs_service.jobs.queue import JobQueue
from fvs_service.jobs.service import Jobs
from fvs_service.missions.service import Missions
from fvs_service.plans.service import Plans
from fvs_service.rankings.port import SceneRunners
from fvs_service.rankings.renders import Renders
from fvs_service.rankings.service import Rankings
from fvs_service.rankings.snapshot_frames import SnapshotFrames
from fvs_service.scenes.lease import Leases
from fvs_service.scenes.service import Scenes
from fvs_service.settings import Settings
from fvs_service.snapshots.service import Snapshots
from fvs_service.storage.blobs import Blobs, require_room
from fvs_service.storage.database import Database, sqlite_file
from fvs_service.storage.removals import Removals
from fvs_service.storage.store_check import StoreCheck
from fvs_service.tracing import Tracing
from fvs_service.visits.repository import taken_poses
from fvs_service.visits.service import Visits
from fvs_service.webhooks.destinations import Destinations
from fvs_service.webhooks.service import Webhooks


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
    store_check: StoreCheck
    uploads: Uploads
    upload_locks: UploadLocks
    upload_places: UploadPlaces
    inspection_turns: FairTurns
    scenes: Scenes
    images: Images
    exclusions: Exclusions
    masks: Masks
    videos: Videos
    jobs: Jobs
    rankings: Rankings
    renders: Renders
    plans: Plans
    forecasts: Forecasts
    visits: Visits
    missions: Missions
    webhooks: Webhooks
    destinations: Destinations
    deletions: Deletions


MakeRunners = Callable[[Storage], SceneRunners]
"""Makes the client of the runners for a storage."""


def open_storage(settings: Settings, tracing: Tracing | None = None) -> AbstractContextManager[Storage]:
    """Open the database, after migrating its schema, and the blobs; close them at the end.

    Creates what does not exist. Raises ``StorageError`` when the root cannot be written.
    """
    with storage_errors(settings.root):
        settings.root.mkdir(parents=True, exist_ok=True)
    return _opened(settings, Database.migrate, tracing)


def open_existing_storage(
    settings: Settings, tracing: Tracing | None = None, *, migrate: bool = False
) -> AbstractContextManager[Storage]:
    """Open the storage of a service that has run before.

    Creates nothing, and migrates the schema only if ``migrate``. Raises ``NotFoundError`` when the database
    or the blobs should be on this machine and are not, and ``IncompatibleDatabaseError`` when the schema has
    another version.
    """
    local = None if settings.blobs.url else settings.blobs_folder
    with storage_errors(settings.root):
        for path in (sqlite_file(settings.database), local):
            if path is not None and not path.exists():
                raise NotFoundError(
                    f"{path} does not exist: no service has run in {settings.root}.",
                    hint="Name the service's folder with --root or FVS_ROOT.",
                )
    return _opened(settings, Database.migrate if migrate else Database.require_migrated, tracing)


@contextmanager
def _opened(
    settings: Settings, prepare: Callable[[Database], None], tracing: Tracing | None = None
) -> Iterator[Storage]:
    with storage_errors(settings.root):
        database = Database(settings.database)
    try:
        prepare(database)
        with storage_errors(settings.root):
            blobs = Blobs(settings.blobs_folder, settings.blobs)
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
            ),
            snapshots=Snapshots(database, blobs),
            removals=Removals(database, blobs, settings.removal_grace_s),
            tracing=tracing or Tracing(),
        )
    finally:
        database.close()


def _require_room_for_results(settings: Settings) -> None:
    """Raise ``OutOfSpaceError`` when free disk space has fallen to half of the reserve.

    A mission continues with rankings and plans when uploads are refused; the other half is for jobs that end
    and for deletions.
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
        inspector = Inspector(image_limits(limits), children=settings.inspectors)
        try:
            jobs = Jobs(storage.database, storage.queue, limits)
            runners = make_runners(storage)
            frames = SnapshotFrames(storage.database, storage.snapshots, limits.candidates_per_ranking)
            require_room_for_results = partial(_require_room_for_results, settings)
            rankings_at_once = ConcurrencyLimit("rankings", limits.rankings_at_once_per_tenant)
            rankings = Rankings(
                storage.database,
                frames,
                runners,
                rankings_at_once,
                taken_poses,
                require_room_for_results,
            )
            renders = Renders(
                storage.database,
                storage.blobs,
                frames,
                runners,
                rankings_at_once,
                require_room_for_results,
            )
            plans = Plans(storage.database, frames, runners, limits, taken_poses, require_room_for_results)
            destinations = Destinations(settings.webhook_hosts)
            uploads = Uploads(
                settings.uploads,
                keep_s=settings.partial_upload_s,
                per_tenant=limits.partial_uploads_per_tenant,
                spared_s=settings.upload_place_s,
                reserve_bytes=settings.reserve_bytes,
                max_bytes=limits.image_bytes,
                max_video_bytes=limits.video_bytes,
            )
            yield Application(
                storage=storage,
                runners=runners,
                store_check=StoreCheck(storage.blobs),
                uploads=uploads,
                upload_locks=UploadLocks(),
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
                masks=Masks(storage.database, storage.blobs, inspector, jobs),
                videos=Videos(storage.database, storage.blobs),
                jobs=jobs,
                rankings=rankings,
                renders=renders,
                plans=plans,
                forecasts=Forecasts(storage.database, frames, runners, limits),
                visits=Visits(storage.database, frames),
                missions=Missions(storage.database, frames, rankings, plans),
                webhooks=Webhooks(storage.database, destinations),
                destinations=destinations,
                deletions=Deletions(storage.database, uploads, settings.removal_grace_s),
            )
        finally:
            inspector.close()
