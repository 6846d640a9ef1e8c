"""Retention of idempotency keys: by age, and by their number in a tenant."""

from collections.abc import Sequence
from datetime import datetime, timedelta

from sqlalchemy import ColumnElement, CursorResult, delete, func, select

from fvs_service.settings import Retention
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.tables import IdempotencyRow


class IdempotencyRetention:
    """Forgets old idempotency keys, and the oldest ones of tenants that have too many."""

    def __init__(self, database: Database, retention: Retention) -> None:
        self._database = database
        self._most, self._age = retention.idempotency_keys, timedelta(days=retention.idempotency_days)
        self._seen: datetime | None = None
        """Tenants without a key after this time cannot have exceeded their limit since."""

    def apply(self) -> int:
        """Forget what is not kept any longer; returns the number of keys."""
        before = now() - self._age
        with self._database.reading() as session:
            oldest = session.scalar(select(func.min(IdempotencyRow.created_at)))
            newest = session.scalar(select(func.max(IdempotencyRow.created_at)))
        if oldest is None:
            return 0
        forgotten = self._forget(IdempotencyRow.created_at < before) if oldest < before else 0
        for tenant_id in self._with_new_keys():
            last_kept = self._last_kept(tenant_id)
            if last_kept is not None:
                forgotten += self._forget(
                    IdempotencyRow.tenant_id == tenant_id, IdempotencyRow.created_at < last_kept
                )
        self._seen = newest
        return forgotten

    def _with_new_keys(self) -> Sequence[str]:
        tenants = select(IdempotencyRow.tenant_id).distinct()
        if self._seen is not None:
            tenants = tenants.where(IdempotencyRow.created_at >= self._seen)
        with self._database.reading() as session:
            return session.scalars(tenants).all()

    def _last_kept(self, tenant_id: str) -> datetime | None:
        """The time of the oldest key that the number allows, None when there are fewer."""
        theirs = select(IdempotencyRow.created_at).where(IdempotencyRow.tenant_id == tenant_id)
        newest_first = theirs.order_by(IdempotencyRow.created_at.desc())
        with self._database.reading() as session:
            return session.scalar(newest_first.offset(self._most - 1).limit(1))

    def _forget(self, *which: ColumnElement[bool]) -> int:
        with self._database.writing() as session:
            result = session.execute(delete(IdempotencyRow).where(*which))
            return result.rowcount if isinstance(result, CursorResult) else 0
