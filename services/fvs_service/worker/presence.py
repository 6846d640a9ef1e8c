"""Which workers live: each shows itself, and one of the others takes over what a dead one left.

A worker that was only frozen, and taken for dead, learns of it when it shows itself again.
"""

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

    def show(self, worker_id: str) -> bool:
        """Say that this worker lives; whether the others still thought so."""
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
        return known is not None

    def take_dead(self, worker_id: str) -> tuple[str, ...]:
        """The workers that are dead for good; each is given to one caller only, until that one is dead too.

        The caller takes over what they left, and then says ``forget``.
        """
        with self._database.reading() as session:
            dead = session.scalars(
                select(WorkerRow.id).where(WorkerRow.expires_at_ms < now_ms(), WorkerRow.id != worker_id)
            ).all()
        if not dead:
            return ()
        with self._database.writing() as session:
            taken = session.scalars(
                update(WorkerRow)
                .where(WorkerRow.id.in_(dead), WorkerRow.expires_at_ms < now_ms())
                .values(expires_at_ms=now_ms() + self._duration_ms)
                .returning(WorkerRow.id)
            )
            return tuple(taken)

    def forget(self, worker_id: str) -> None:
        """A dead worker has left nothing any more."""
        with self._database.writing() as session:
            session.execute(delete(WorkerRow).where(WorkerRow.id == worker_id))
