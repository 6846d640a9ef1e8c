"""Leases: the exclusive, expiring right of a worker to a scene, with a fencing token.

A worker acquires the lease, extends it while it works, and commits nothing without its token: every commit
checks in its own transaction that the token is the newest. A worker that was frozen finds its token stale
(``StaleLeaseError``) and must stop. Times are the database's, so workers' clocks do not matter.
"""

from dataclasses import dataclass

from sqlalchemy import CursorResult, bindparam, or_, select, update
from sqlalchemy.orm import Session

from fvs_service.errors import NotFoundError, StaleLeaseError
from fvs_service.storage.clock import now_ms
from fvs_service.storage.database import Database, Reader
from fvs_service.storage.tables import SceneLeaseRow, SceneRow, columns_of

_LEASES = columns_of(SceneLeaseRow)
_HOLDER = select(_LEASES.c.scene_id, _LEASES.c.worker_id, _LEASES.c.token, _LEASES.c.endpoint).where(
    _LEASES.c.scene_id == bindparam("scene_id"), _LEASES.c.expires_at_ms > now_ms()
)
"""A statement that is built once, because every ranking executes it."""


@dataclass(frozen=True)
class Lease:
    """A worker's right to a scene; ``endpoint`` is the address of its runner (None while it has none)."""

    scene_id: str
    worker_id: str
    token: int
    endpoint: str | None = None


class Leases:
    """Acquires, extends, releases and looks up leases."""

    def __init__(self, database: Database, duration_s: float) -> None:
        self._database = database
        self._duration_ms = round(duration_s * 1000)

    def acquire(self, scene_id: str, worker_id: str, *, after: int | None = None) -> Lease | None:
        """Acquire the lease if it is free, has expired, or is this worker's; else return None.

        Every acquired lease has a new token, which makes all earlier ones stale. Raises ``NotFoundError`` for
        a deleted scene, ``StaleLeaseError`` when ``after`` is given and no longer the newest token.
        """
        with self._database.writing(scene_id) as session:
            expires = now_ms() + self._duration_ms
            row = session.get(SceneLeaseRow, scene_id, with_for_update=True)
            newest = 0 if row is None else row.token
            if after not in (None, newest):
                raise _stale(Lease(scene_id, worker_id, after))
            if row is None:
                if session.get(SceneRow, scene_id) is None:
                    raise NotFoundError("There is no such scene.")
                session.add(
                    SceneLeaseRow(
                        scene_id=scene_id, worker_id=worker_id, endpoint=None, token=1, expires_at_ms=expires
                    )
                )
                return Lease(scene_id, worker_id, 1)
            token = newest + 1
            taken = session.execute(
                update(SceneLeaseRow)
                .where(
                    SceneLeaseRow.scene_id == scene_id,
                    SceneLeaseRow.token == row.token,
                    or_(SceneLeaseRow.worker_id == worker_id, SceneLeaseRow.expires_at_ms <= now_ms()),
                )
                .values(worker_id=worker_id, endpoint=None, token=token, expires_at_ms=expires)
                .execution_options(synchronize_session=False)
            )
            return Lease(scene_id, worker_id, token) if _changed(taken) else None

    def extend(self, lease: Lease, endpoint: str | None = None) -> Lease:
        """Extend the lease, and record the runner's endpoint; raises ``StaleLeaseError``."""
        endpoint = endpoint or lease.endpoint
        self._update(lease, endpoint=endpoint, expires_at_ms=now_ms() + self._duration_ms)
        return Lease(lease.scene_id, lease.worker_id, lease.token, endpoint)

    def release(self, lease: Lease) -> None:
        """Release the lease; no effect when another worker has it."""
        with self._database.writing() as session:
            session.execute(
                update(SceneLeaseRow)
                .where(SceneLeaseRow.scene_id == lease.scene_id, SceneLeaseRow.token == lease.token)
                .values(endpoint=None, expires_at_ms=0)
            )

    def newest_token(self, scene_id: str) -> int:
        """The newest token of the scene's lease; 0 before the first."""
        with self._database.reading() as session:
            return session.scalar(select(_LEASES.c.token).where(_LEASES.c.scene_id == scene_id)) or 0

    def holder(self, scene_id: str) -> Lease | None:
        """The lease in force; None when there is none."""
        with self._database.reading() as session:
            row = session.execute(_HOLDER, {"scene_id": scene_id}).one_or_none()
            return None if row is None else Lease(*row)

    def _update(self, lease: Lease, **values: object) -> None:
        with self._database.writing() as session:
            done = session.execute(
                update(SceneLeaseRow)
                .where(SceneLeaseRow.scene_id == lease.scene_id, SceneLeaseRow.token == lease.token)
                .values(**values)
            )
            if not _changed(done):
                raise _stale(lease)


def find_endpoint(reader: Reader, scene_id: str) -> str | None:
    """The endpoint of the scene's runner, by the lease in force; None without one."""
    row = reader.execute(_HOLDER, {"scene_id": scene_id}).one_or_none()
    return None if row is None else row.endpoint


def require_lease(session: Session, lease: Lease) -> None:
    """Make the transaction of ``session`` depend on ``lease``; raises ``StaleLeaseError``.

    The row is written, so that no other worker can acquire the lease before this transaction ends. An expired
    lease is valid until another worker acquires it: its token is the newest.
    """
    fenced = session.execute(
        update(SceneLeaseRow)
        .where(SceneLeaseRow.scene_id == lease.scene_id, SceneLeaseRow.token == lease.token)
        .values(token=lease.token)
    )
    if not _changed(fenced):
        raise _stale(lease)


def _changed(result: object) -> bool:
    return isinstance(result, CursorResult) and result.rowcount == 1


def _stale(lease: Lease) -> StaleLeaseError:
    return StaleLeaseError(
        f"Worker {lease.worker_id} has lost the lease of scene {lease.scene_id} (token {lease.token}).",
        hint="Stop: another worker, or host, has the scene.",
    )
