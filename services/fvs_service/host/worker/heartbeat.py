"""Heartbeats of workers: what a worker's row says about it, and which workers are alive."""

import time

from sqlalchemy import delete, insert, select, update

from fvs_service.errors import ConflictError
from fvs_service.jobs.fleet import HEARTBEAT_S, is_alive
from fvs_service.storage.clock import now_ms
from fvs_service.storage.database import Database
from fvs_service.storage.tables import WorkerRow, columns_of

_WORKERS = columns_of(WorkerRow)
_WATCH_S = 1.5 * HEARTBEAT_S
_LOOK_S = 0.2


class Heartbeats:
    """Records the heartbeats of one worker; times are the database's."""

    def __init__(self, database: Database, worker_id: str) -> None:
        self._database, self._worker_id = database, worker_id

    def beat(
        self,
        *,
        slots: int = 1,
        disk_full: bool = False,
        backend: str = "auto",
        runner_bytes: int = 0,
    ) -> None:
        """Record that this worker is alive.

        ``slots``: the number of jobs that it runs at once; ``disk_full``: it takes none for lack of room;
        ``runner_bytes``: the resident memory of its runners.
        """
        state = {
            "slots": slots,
            "disk_full": disk_full,
            "backend": backend,
            "runner_bytes": runner_bytes,
            "beaten_at_ms": now_ms(),
        }
        known = update(_WORKERS).where(_WORKERS.c.id == self._worker_id).values(state)
        with self._database.writing() as session:
            if session.scalar(known.returning(_WORKERS.c.id)) is None:
                session.execute(insert(_WORKERS).values(id=self._worker_id, **state))

    def end(self) -> None:
        """Record that this worker has ended; its jobs wait for its successor of the same id."""
        with self._database.writing() as session:
            session.execute(delete(_WORKERS).where(_WORKERS.c.id == self._worker_id))


def require_no_workers(database: Database) -> None:
    """Raise ``ConflictError`` when a worker sends heartbeats: another service runs on the database.

    Returns at once when no worker is alive, as after a clean stop; else it watches for a little longer than
    the time between two heartbeats.
    """
    before = _last_beats(database)
    until = time.monotonic() + _WATCH_S
    while before and time.monotonic() < until:
        time.sleep(_LOOK_S)
        if not _last_beats(database).items() <= before.items():
            raise ConflictError(
                "Another fvs serve runs workers on this database.",
                hint="Stop that one: many machines need FVS_CLUSTER, and have one dispatcher.",
            )


def _last_beats(database: Database) -> dict[str, int]:
    """When each live worker sent its last heartbeat."""
    with database.reading() as session:
        rows = session.execute(select(WorkerRow.id, WorkerRow.beaten_at_ms).where(is_alive()))
        return {row.id: row.beaten_at_ms for row in rows}
