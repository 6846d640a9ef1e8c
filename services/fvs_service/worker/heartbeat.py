"""Heartbeats of workers: they show which workers are alive, so that others take over the jobs of dead ones.

A worker that was only frozen finds at its next heartbeat that it was declared dead.
"""

from dataclasses import dataclass

from sqlalchemy import delete, insert, update

from fvs_service.fleet import MISSED_LEASES
from fvs_service.storage.database import Database, now_ms
from fvs_service.storage.tables import WorkerRow, columns_of

_WORKERS = columns_of(WorkerRow)


@dataclass(frozen=True)
class Heartbeat:
    """What the database answers to a heartbeat.

    ``known``: it knew the worker, and no other has declared it dead. ``dead``: the ids of dead workers; each
    goes to one caller only, unless that one dies too. The caller puts back their jobs, then calls ``forget``.
    """

    known: bool
    dead: tuple[str, ...]


class Heartbeats:
    """Writes and reads heartbeats; times are the database's."""

    def __init__(self, database: Database, lease_s: float) -> None:
        self._database = database
        self._duration_ms = round(MISSED_LEASES * lease_s * 1000)

    def beat(
        self,
        worker_id: str,
        *,
        slots: int = 1,
        disk_full: bool = False,
        backend: str = "auto",
        work: str = "all",
        runner_bytes: int = 0,
    ) -> Heartbeat:
        """Record that this worker is alive, and claim the dead ones.

        ``slots``: the number of jobs that it runs at once; ``disk_full``: it takes none for lack of room;
        ``work``: the kinds of work that it does; ``runner_bytes``: the resident memory of its runners.
        """
        state = {
            "slots": slots,
            "disk_full": disk_full,
            "backend": backend,
            "work": work,
            "runner_bytes": runner_bytes,
            "beaten_at_ms": now_ms(),
            "expires_at_ms": now_ms() + self._duration_ms,
        }
        # One transaction: it is most of what an idle worker does.
        with self._database.writing() as session:
            known = session.scalar(
                update(_WORKERS).where(_WORKERS.c.id == worker_id).values(state).returning(_WORKERS.c.id)
            )
            if known is None:
                session.execute(insert(_WORKERS).values(id=worker_id, **state))
            dead = session.scalars(
                update(_WORKERS)
                .where(_WORKERS.c.expires_at_ms < now_ms(), _WORKERS.c.id != worker_id)
                .values(expires_at_ms=now_ms() + self._duration_ms)
                .returning(_WORKERS.c.id)
            ).all()
        return Heartbeat(known is not None, tuple(dead))

    def forget(self, worker_id: str) -> None:
        """Delete the row of a dead worker, after its jobs were put back."""
        with self._database.writing() as session:
            session.execute(delete(_WORKERS).where(_WORKERS.c.id == worker_id))
