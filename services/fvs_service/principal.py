"""Principals: the authenticated callers, and their permissions."""

from dataclasses import dataclass
from enum import StrEnum

from fvs_service.errors import ForbiddenError, NotFoundError

LOCAL_TENANT = "local"


class Scope(StrEnum):
    """A permission of a key."""

    READ = "read"
    UPLOAD = "upload"
    """Send images: what a device needs."""
    OPERATE = "operate"
    """Create scenes, start and cancel jobs, create rankings."""


ALL_SCOPES = frozenset(Scope)


@dataclass(frozen=True)
class Principal:
    """An authenticated caller; ``scene_id`` restricts a device's key to its scene.

    ``key_id`` is empty for the local user, who needs no key.
    """

    tenant_id: str
    scopes: frozenset[Scope]
    scene_id: str | None = None
    key_id: str = ""

    def owns(self, tenant_id: str, scene_id: str) -> bool:
        """Whether a scene of a tenant is visible to the caller."""
        return tenant_id == self.tenant_id and self.scene_id in (None, scene_id)

    def require(self, scope: Scope, scene_id: str | None = None) -> None:
        """Raise ``ForbiddenError`` without the scope, ``NotFoundError`` for a scene other than the key's."""
        if self.scene_id is not None and scene_id is not None and scene_id != self.scene_id:
            raise NotFoundError("There is no such scene.")
        bound = self.scene_id is not None and scene_id is None
        if bound or scope not in self.scopes:
            raise ForbiddenError(
                f"This needs a key with the scope {scope.value!r}"
                + (" that is not bound to one scene." if bound else "."),
                hint="Create another key: fvs keys create --scope …",
            )


LOCAL_USER = Principal(LOCAL_TENANT, ALL_SCOPES)
"""The caller without a key, where none is required."""
