"""API keys: created, listed, revoked and checked.

A key is ``fvs_<id>_<secret>``. It is shown once; the database keeps the SHA-256 of the secret, whose 256
random bits need no slow hash. A key may be restricted to one scene: a device's key.
"""

import hashlib
import hmac
import re
import secrets
from dataclasses import dataclass
from datetime import datetime, timedelta

from sqlalchemy import select, update
from sqlalchemy.orm import Session

from fvs_service.errors import NotFoundError, UnauthenticatedError
from fvs_service.principal import ALL_SCOPES, LOCAL_TENANT, LOCAL_USER, Principal, Scope
from fvs_service.storage.clock import now
from fvs_service.storage.database import Database
from fvs_service.storage.tables import ApiKeyRow, SceneRow

_PREFIX = "fvs"
_KEY = re.compile(r"fvs_([0-9a-f]{16})_([A-Za-z0-9_-]{43})")
_NO_HASH = hashlib.sha256(b"").hexdigest()


@dataclass(frozen=True)
class ApiKey:
    """A key without its secret."""

    id: str
    tenant_id: str
    name: str
    scopes: frozenset[Scope]
    scene_id: str | None
    created_at: datetime
    expires_at: datetime | None
    revoked_at: datetime | None

    @property
    def valid(self) -> bool:
        """Whether it is neither revoked nor expired."""
        return self.revoked_at is None and (self.expires_at is None or self.expires_at > now())


class Keys:
    """Creates, lists, revokes and checks API keys."""

    def __init__(self, database: Database, *, required: bool | None) -> None:
        self._database = database
        self._required = required

    @property
    def required(self) -> bool:
        """Whether every request needs a key.

        If the settings leave it open, one does once there is a key, also one that is expired or revoked: the
        end of the last key must not let everyone in.
        """
        if self._required is None:
            with self._database.reading() as session:
                if session.scalar(select(ApiKeyRow.id).limit(1)) is None:
                    return False
            self._required = True  # keys are never deleted
        return self._required

    def create(
        self,
        name: str,
        *,
        tenant_id: str = LOCAL_TENANT,
        scopes: frozenset[Scope] = ALL_SCOPES,
        scene_id: str | None = None,
        valid_for: timedelta | None = None,
    ) -> str:
        """Create a key and return it; it cannot be read again.

        Raises ``NotFoundError`` when the tenant has no scene ``scene_id``.
        """
        key_id, secret = secrets.token_hex(8), secrets.token_urlsafe(32)
        with self._database.writing() as session:
            if scene_id is not None:
                scene = session.get(SceneRow, scene_id)
                if scene is None or scene.tenant_id != tenant_id:
                    raise NotFoundError(
                        f"Tenant {tenant_id} has no scene {scene_id}.",
                        hint="fvs-client scenes list shows the scenes of a key's tenant.",
                    )
            session.add(
                ApiKeyRow(
                    id=key_id,
                    tenant_id=tenant_id,
                    name=name,
                    sha256=_hash(secret),
                    scopes=sorted(scope.value for scope in scopes),
                    scene_id=scene_id,
                    created_at=now(),
                    expires_at=None if valid_for is None else now() + valid_for,
                    revoked_at=None,
                )
            )
        return f"{_PREFIX}_{key_id}_{secret}"

    def all(self) -> tuple[ApiKey, ...]:
        """Every key, the oldest first."""
        with self._database.reading() as session:
            return tuple(map(_key, session.scalars(select(ApiKeyRow).order_by(ApiKeyRow.created_at))))

    def revoke(self, key_id: str) -> None:
        """Revoke a key at once; raises ``NotFoundError``."""
        with self._database.writing() as session:
            if session.get(ApiKeyRow, key_id) is None:
                raise NotFoundError(f"There is no key {key_id}.", hint="fvs keys list shows them.")
            session.execute(update(ApiKeyRow).where(ApiKeyRow.id == key_id).values(revoked_at=now()))

    def authenticate(self, key: str | None) -> Principal:
        """The principal of a key; raises ``UnauthenticatedError``.

        Without a key it is the local user, unless keys are ``required``.
        """
        if key is None:
            if self.required:
                raise UnauthenticatedError(
                    "No API key was given.",
                    hint="Set FVS_API_KEY for fvs-client; otherwise send Authorization: Bearer fvs_…",
                )
            return LOCAL_USER
        found = _KEY.fullmatch(key)
        if found is None:
            raise _unknown()
        key_id, secret = found.groups()
        with self._database.reading() as session:
            row = session.get(ApiKeyRow, key_id)
            # Unknown keys cost the same comparison as known ones.
            matches = hmac.compare_digest(_hash(secret), row.sha256 if row else _NO_HASH)
            if row is None or not matches or not _key(row).valid:
                raise _unknown()
            return Principal(row.tenant_id, frozenset(map(Scope, row.scopes)), row.scene_id, row.id)

    def require_valid(self, session: Session, principal: Principal) -> None:
        """Raise ``UnauthenticatedError`` if the principal's key has been revoked, or has expired."""
        if not principal.key_id:
            return
        row = session.get(ApiKeyRow, principal.key_id)
        if row is None or not _key(row).valid:
            raise _unknown()


def bearer_key(authorization: str) -> str | None:
    """The key in an ``Authorization`` header or metadata; None where there is none."""
    scheme, _, key = authorization.partition(" ")
    return key.strip() if scheme.lower() == "bearer" else None


def _unknown() -> UnauthenticatedError:
    return UnauthenticatedError(
        "The API key is unknown, expired or revoked.",
        hint="List keys with fvs keys list --root …, or create one with fvs keys create.",
    )


def _hash(secret: str) -> str:
    return hashlib.sha256(secret.encode()).hexdigest()


def _key(row: ApiKeyRow) -> ApiKey:
    return ApiKey(
        id=row.id,
        tenant_id=row.tenant_id,
        name=row.name,
        scopes=frozenset(map(Scope, row.scopes)),
        scene_id=row.scene_id,
        created_at=row.created_at,
        expires_at=row.expires_at,
        revoked_at=row.revoked_at,
    )
