"""Idempotency keys: the same request with the same key creates its resource once."""

import hashlib
from collections.abc import Callable
from typing import TypeVar

from sqlalchemy import bindparam, insert, select
from sqlalchemy.orm import Session

from fvs_schema.base import Model
from fvs_service.errors import GoneError, KeyReusedError, NotFoundError
from fvs_service.storage.clock import now
from fvs_service.storage.database import Reader
from fvs_service.storage.tables import IdempotencyRow, columns_of

_KEYS = columns_of(IdempotencyRow)
_KNOWN = select(_KEYS.c.fingerprint, _KEYS.c.resource_id).where(
    _KEYS.c.tenant_id == bindparam("tenant_id"), _KEYS.c.key == bindparam("key")
)

_Resource = TypeVar("_Resource")


class IdempotencyKey:
    """A tenant's key for one operation with one request."""

    def __init__(self, tenant_id: str, key: str | None, operation: str, request: Model) -> None:
        self._tenant_id, self._key = tenant_id, key
        self._operation, self._request = operation, request

    def resource(self, reader: Reader, find: Callable[[str], _Resource]) -> _Resource | None:
        """The resource that this key created, found by its id; None for a new key.

        Raises ``KeyReusedError`` for another request, ``GoneError`` when the resource has been deleted: a
        late repetition must not create it again.
        """
        resource_id = self.resource_id(reader)
        if resource_id is None:
            return None
        try:
            return find(resource_id)
        except NotFoundError as error:
            raise GoneError(
                f"The request with this Idempotency-Key created {resource_id}, which has been deleted.",
                hint="Use a new key to create another one.",
            ) from error

    def resource_id(self, reader: Reader) -> str | None:
        """The id of the resource that this key created; raises ``KeyReusedError`` for another request."""
        if self._key is None:
            return None
        row = reader.execute(_KNOWN, {"tenant_id": self._tenant_id, "key": self._key}).one_or_none()
        if row is None:
            return None
        if row.fingerprint != self._fingerprint():
            raise KeyReusedError(
                "This Idempotency-Key was used with another request.", hint="Use a new key for each request."
            )
        resource_id: str = row.resource_id
        return resource_id

    def remember(self, session: Session, resource_id: str) -> None:
        """Record the resource, in the transaction that creates it."""
        if self._key is None:
            return
        session.execute(
            insert(_KEYS),
            {
                "tenant_id": self._tenant_id,
                "key": self._key,
                "fingerprint": self._fingerprint(),
                "resource_id": resource_id,
                "created_at": now(),
            },
        )

    def _fingerprint(self) -> str:
        content = f"{self._operation}\n{self._request.model_dump_json()}"
        return hashlib.sha256(content.encode()).hexdigest()
