"""Who asks, and what they may do."""

from dataclasses import dataclass
from enum import StrEnum

from fvs_service.errors import ForbiddenError, NotFoundError

LOCAL_TENANT = "local"


class Scope(StrEnum):
    """What a key may do."""

    READ = "read"
    UPLOAD = "upload"
    """Send images; all that a device needs."""
    OPERATE = "operate"
    """Make scenes, start and stop jobs, ask for rankings."""


ALL_SCOPES = frozenset(Scope)


@dataclass(frozen=True)
class Principal:
    """Who asks, and what they may do; ``scene_id`` limits a device's key to its scene."""

    tenant_id: str
    scopes: frozenset[Scope]
    scene_id: str | None = None

    def require(self, scope: Scope, scene_id: str | None = None) -> None:
        """Raise ``ForbiddenError`` without the scope, ``NotFoundError`` for a scene the key is not for."""
        if self.scene_id is not None and scene_id is not None and scene_id != self.scene_id:
            raise NotFoundError("There is no such scene.")
        if scope not in self.scopes or (self.scene_id is not None and scene_id is None):
            raise ForbiddenError(
                f"This needs a key with the scope {scope.value!r}"
                + (" that is not bound to one scene." if self.scene_id is not None else "."),
                hint="Ask for another key: fvs keys create --scope …",
            )


LOCAL_USER = Principal(LOCAL_TENANT, ALL_SCOPES)
"""Whoever sits at a machine that serves only itself."""
