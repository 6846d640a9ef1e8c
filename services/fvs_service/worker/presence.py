"""Which workers live: each shows itself, and one of the others takes over what a dead one left."""

from sqlalchemy import delete, select, update

from fvs_service.storage.database import Database, now_ms
from fvs_service.storage.tables import WorkerRow

_MISSED = 3
"""A worker that has not shown itself for so many leases is dead for good; its supervisor would have
started it again long ago."""


class Presence:
    """Shows that a worker lives; times are the database's."""

    def __init__(self, database: Database, lease_s: float) -> None:
        self._database = database
        self._duration_ms = round(_MISSED * lease_s * 1000)

    def show(self, worker_id: str) -> None:
        """Say that this worker lives."""
        until = now_ms() + self._duration_ms
        with self._database.writing() as session:
            known = session.scalar(
                update(WorkerRow)
                .where(WorkerRow.id == worker_id)
                .values(expires_at_ms=until)
                .returning(WorkerRow.id)
            )
            if known is None:
                session.add(WorkerRow(id=worker_id, expires_at_ms=until))

    def take_dead(self, worker_id: str) -> tuple[str, ...]:
        """The workers that are dead for good; each is given to one caller only."""
        with self._database.reading() as session:
            dead = session.scalars(
                select(WorkerRow.id).where(WorkerRow.expires_at_ms < now_ms(), WorkerRow.id != worker_id)
            ).all()
        if not dead:
            return ()
        with self._database.writing() as session:
            taken = session.scalars(
                delete(WorkerRow)
                .where(WorkerRow.id.in_(dead), WorkerRow.expires_at_ms < now_ms())
                .returning(WorkerRow.id)
            )
            return tuple(taken)
