"""What is wrong with a deployment: the object store, clocks, workers, access, disks."""

import time
from collections.abc import Iterator
from dataclasses import dataclass

from sqlalchemy import select

from fvs_engine.errors import StorageError
from fvs_engine.files.private_folder import private_folder
from fvs_service.application import Storage
from fvs_service.errors import ForbiddenError, StorageUnavailableError
from fvs_service.gateway.protection import access_of
from fvs_service.jobs.fleet import workers_of
from fvs_service.logs import reason_of
from fvs_service.settings import GPU_MEMORY, Settings
from fvs_service.storage.blob_keys import image_key
from fvs_service.storage.blobs import Blobs, free_bytes
from fvs_service.storage.clock import now_ms
from fvs_service.storage.database import sqlite_file
from fvs_service.storage.owner import require_known_images, require_own_store
from fvs_service.storage.tables import ImageRow

_SKEW_S = 5.0
_SAMPLE = 100
"""Images that are looked for in the blob store."""


@dataclass(frozen=True)
class Trouble:
    """A fault that only an operator can repair; while a ``serious`` one lasts, blobs cannot be examined."""

    what: str
    hint: str
    serious: bool = False


def _another_store(storage: Storage) -> Iterator[Trouble]:
    """A blob store that has none of the database's images: repairing would delete the rows of all."""
    with storage.database.reading() as session:
        query = select(ImageRow.scene_id, ImageRow.sha256).where(ImageRow.verdict == "accepted")
        images = session.execute(query.limit(_SAMPLE)).all()
    keys = [image_key(scene_id, sha256) for scene_id, sha256 in images]
    if keys and not any(map(storage.blobs.exists, keys)):
        yield Trouble(
            "The blob store has none of the images that the database knows.",
            "Check --root and FVS_BLOBS__URL. If the bytes are lost, restore a backup, or delete the scenes.",
            serious=True,
        )


def troubles(storage: Storage) -> Iterator[Trouble]:
    """The faults of this machine and of the deployment, each with its remedy."""
    try:
        storage.blobs.check()
        if not require_own_store(storage.database, storage.blobs):
            require_known_images(storage.database, storage.blobs)
        yield from _another_store(storage)
    except StorageUnavailableError as error:
        yield Trouble(error.message, error.hint, serious=True)
    else:
        yield from _rights(storage.blobs)
    before = time.time()
    with storage.database.reading() as session:
        database_s = (session.scalar(select(now_ms())) or 0) / 1000
        workers = workers_of(session)
    skew_s = (before + time.time()) / 2 - database_s
    if abs(skew_s) > _SKEW_S:
        side = "ahead of" if skew_s > 0 else "behind"
        yield Trouble(
            f"This machine's clock is {abs(skew_s):.0f} s {side} the database's.",
            "Synchronise the clocks of all machines (NTP): keys expire and events are dated by them.",
        )
    for worker in workers:
        if not worker.alive:
            yield Trouble(
                f"Worker {worker.id} has sent no heartbeat for {worker.heartbeat_age_s:.0f} s.",
                "Look at the log of its fvs serve, which restarts a worker that is silent for three minutes.",
            )
        elif worker.disk_full:
            yield Trouble(f"Worker {worker.id} takes no jobs: its disk is full.", "Free some space there.")
        elif worker.slots == 0:
            yield Trouble(
                f"Worker {worker.id} takes no jobs: it cannot reach its Ray cluster.",
                "Look at the log of its fvs serve, which has the reason, and what to do.",
            )
    yield from _of_access(storage)
    yield from _of_this_machine(storage.settings)


def troubles_without_database(settings: Settings, error: StorageUnavailableError) -> Iterator[Trouble]:
    """The finding for an unreachable database, caused by ``error``, and those that need no database."""
    file = sqlite_file(settings.database)
    yield Trouble(
        f"{error.message.rstrip('.')}: {' '.join(reason_of(error).split())}",
        "Check FVS_DATABASE_URL, that the server runs, and that it lets this machine connect."
        if file is None
        else f"Check {file} (--root or FVS_DATABASE_URL), its disk and its rights. If it is damaged, restore "
        "a backup.",
        serious=True,
    )
    try:
        blobs = Blobs(settings.blobs_folder, settings.blobs)
        blobs.check()
    except StorageUnavailableError as failure:
        yield Trouble(failure.message, failure.hint, serious=True)
    else:
        yield from _rights(blobs)
    yield from _of_this_machine(settings)


def _rights(blobs: Blobs) -> Iterator[Trouble]:
    try:
        blobs.check_rights()
    except StorageUnavailableError as error:
        yield Trouble(error.message, error.hint)


def _of_access(storage: Storage) -> Iterator[Trouble]:
    """Findings about access without keys from other machines, and about keys that cannot be used."""
    hosts = storage.settings.remote_hosts
    try:
        access_of(storage)
    except ForbiddenError as error:
        yield Trouble(error.message, error.hint)
    else:
        if hosts and not storage.keys.required:
            yield Trouble(
                f"Whoever reaches the service as {' or '.join(hosts)} may use it: FVS_REQUIRE_KEYS is false.",
                "Unset it unless something else keeps strangers out.",
            )


def _of_this_machine(settings: Settings) -> Iterator[Trouble]:
    if settings.worker.backend != "cpu":
        try:
            private_folder(GPU_MEMORY)
        except StorageError as error:
            yield Trouble(error.message, f"Jobs cannot train on a GPU of this machine. {error.hint}")
    if not settings.root.is_dir():  # the database and the blobs are elsewhere
        yield Trouble(
            f"There is no folder {settings.root}: this machine's disk and working folders are not examined.",
            "Name the service's folder with --root or FVS_ROOT.",
        )
    elif free_bytes(settings.root) < settings.reserve_bytes:
        yield Trouble(
            "This machine's disk has come to the reserve.", "Free some space, or lower FVS_RESERVE_BYTES."
        )
