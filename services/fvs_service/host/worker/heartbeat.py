"""Heartbeats of workers: what a worker's row says about it, and which workers are alive."""

import time

from sqlalchemy import delete, insert, select, update

from fvs_service.errors import ConflictError
from fvs_service.ids import new_id
from fvs_service.jobs.fleet import HEARTBEAT_S, is_alive
from fvs_service.storage.clock import now_ms
from fvs_service.storage.database import Database
from fvs_service.storage.tables import WorkerRow, columns_of

_WORKERS = columns_of(WorkerRow)
_WATCH_S = 1.5 * HEARTBEAT_S
_LOOK_S = 0.2


class Heartbeats:
    """Records the heartbeats of one process of a worker; times are the database's.

    The first one makes this process the worker, and no other one any longer.
    """

    def __init__(self, database: Database, worker_id: str) -> None:
        self._database, self._worker_id = database, worker_id
        self._process_id = new_id("prc")
        self._is_mine = (_WORKERS.c.id == worker_id, _WORKERS.c.process_id == self._process_id)
        self._begun = False

    def beat(
        self,
        *,
        slots: int = 1,
        disk_full: bool = False,
        backend: str = "auto",
        runner_bytes: int = 0,
    ) -> bool:
        """Record that this worker is alive; returns whether this process is still the worker.

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
        with self._database.writing() as session:
            if not self._begun:
                session.execute(delete(_WORKERS).where(_WORKERS.c.id == self._worker_id))
                identity = {"id": self._worker_id, "process_id": self._process_id}
                session.execute(insert(_WORKERS).values(**identity, **state))
            else:
                beaten = update(_WORKERS).where(*self._is_mine).values(state).returning(_WORKERS.c.id)
                if session.scalar(beaten) is None:
                    return False
        self._begun = True
        return True

    def end(self) -> None:
        """Record that this worker has ended; its jobs wait for its successor of the same id."""
        with self._database.writing() as session:
            session.execute(delete(_WORKERS).where(*self._is_mine))


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
