"""The examination: everything the doctor looks for, in order; safe while the service runs."""

from collections.abc import Iterator
from datetime import timedelta

from sqlalchemy import func, select

from fvs_service.application import Storage
from fvs_service.doctor import blobs, folders
from fvs_service.doctor.finding import Finding
from fvs_service.jobs.repository import OPEN
from fvs_service.settings import Settings
from fvs_service.storage.blobs import Blobs
from fvs_service.storage.clock import now
from fvs_service.storage.tables import JobRow, WorkerRow


def examine(storage: Storage, grace: timedelta) -> Iterator[Finding]:
    """What is wrong; files and blobs younger than ``grace`` may belong to something in progress."""
    before = now() - grace
    yield from blobs.late_removals(storage, grace)
    yield from blobs.blobs_without_rows(storage, before)
    yield from blobs.unfinished_blobs(storage.blobs, before)
    yield from blobs.images_without_blobs(storage)
    yield from blobs.snapshots_without_blobs(storage)
    yield from folders.folders_of_no_scene(storage, before)
    yield from folders.abandoned_uploads(storage.settings, before)
    yield from jobs_of_no_worker(storage)


def examine_without_database(settings: Settings, grace: timedelta) -> Iterator[Finding]:
    """Findings about this machine's disk that need no database."""
    before = now() - grace
    if settings.blobs.url is None:
        yield from blobs.unfinished_blobs(Blobs(settings.blobs_folder), before)
    yield from folders.abandoned_uploads(settings, before)


def jobs_of_no_worker(storage: Storage) -> Iterator[Finding]:
    """Unfinished jobs of workers that are no longer registered."""
    query = select(JobRow.worker_id, func.count()).where(
        JobRow.worker_id.is_not(None), JobRow.worker_id.not_in(select(WorkerRow.id)), JobRow.state.in_(OPEN)
    )
    with storage.database.reading() as session:
        lost = session.execute(query.group_by(JobRow.worker_id)).all()
    for worker_id, number in lost:
        yield Finding(
            "jobs of no worker",
            f"{number} of {worker_id}",
            "let them wait for another",
            lambda worker_id=worker_id: storage.queue.put_back_all(worker_id),  # type: ignore[misc]
        )
