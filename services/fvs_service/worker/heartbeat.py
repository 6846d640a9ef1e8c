"""Heartbeats of workers: they show which workers are alive, so that others take over the jobs of dead ones.

A worker that was only frozen finds at its next heartbeat that it was declared dead.
"""

from sqlalchemy import delete, select, update

from fvs_service.fleet import MISSED_LEASES
from fvs_service.storage.database import Database, now_ms
from fvs_service.storage.tables import WorkerRow


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
    ) -> bool:
        """Record that this worker is alive; False when it was unknown, or was declared dead.

        ``slots``: the number of jobs that it runs at once; ``disk_full``: it takes none for lack of room;
        ``work``: the kinds of work that it does; ``runner_bytes``: the resident memory of its runners.
        """
        state = {
            "slots": slots,
            "disk_full": disk_full,
            "backend": backend,
            "work": work,
            "runner_bytes": runner_bytes,
        }
        until = now_ms() + self._duration_ms
        with self._database.writing() as session:
            known = session.scalar(
                update(WorkerRow)
                .where(WorkerRow.id == worker_id)
                .values(beaten_at_ms=now_ms(), expires_at_ms=until, **state)
                .returning(WorkerRow.id)
            )
            if known is None:
                session.add(WorkerRow(id=worker_id, beaten_at_ms=now_ms(), expires_at_ms=until, **state))
        return known is not None

    def claim_dead(self, worker_id: str) -> tuple[str, ...]:
        """The ids of dead workers; each goes to one caller only, unless that one dies too.

        The caller puts back their jobs and then calls ``forget``.
        """
        with self._database.reading() as session:
            dead = session.scalars(
                select(WorkerRow.id).where(WorkerRow.expires_at_ms < now_ms(), WorkerRow.id != worker_id)
            ).all()
        if not dead:
            return ()
        with self._database.writing() as session:
            claimed = session.scalars(
                update(WorkerRow)
                .where(WorkerRow.id.in_(dead), WorkerRow.expires_at_ms < now_ms())
                .values(expires_at_ms=now_ms() + self._duration_ms)
                .returning(WorkerRow.id)
            )
            return tuple(claimed)

    def forget(self, worker_id: str) -> None:
        """Delete the row of a dead worker, after its jobs were put back."""
        with self._database.writing() as session:
            session.execute(delete(WorkerRow).where(WorkerRow.id == worker_id))
