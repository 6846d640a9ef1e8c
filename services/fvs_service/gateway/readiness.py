"""Whether the gateway can serve."""

import shutil
from collections.abc import Sequence

from fvs_schema.service import WorkerStatus
from fvs_service.application import Application
from fvs_service.errors import OutOfSpaceError, UnavailableError
from fvs_service.jobs.fleet import workers_of


def require_ready(app: Application, workers: int = 0) -> None:
    """Raise unless the gateway can store images and at least ``workers`` workers are alive.

    Raises ``UnavailableError``, ``StorageUnavailableError`` and ``OutOfSpaceError``.
    """
    with app.storage.database.reading() as session:
        known = workers_of(session)
    settings = app.storage.settings
    if shutil.disk_usage(settings.root).free < settings.reserve_bytes:
        raise OutOfSpaceError("The disk is full.", hint="Free some space.", retry_after_s=60)
    app.store_check.require()
    _require_workers(known, workers)


def _require_workers(known: Sequence[WorkerStatus], least: int) -> None:
    alive = sum(worker.alive for worker in known)
    if alive >= least:
        return
    silent = ", ".join(
        f"{worker.id} for {worker.heartbeat_age_s:.0f} s" for worker in known if not worker.alive
    )
    raise UnavailableError(
        f"{alive} of {least} required workers are alive."
        + (f" No heartbeat from {silent}." if silent else ""),
        hint="The log of fvs serve shows why workers end.",
        retry_after_s=5,
    )
