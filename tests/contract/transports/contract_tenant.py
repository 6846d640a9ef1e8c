"""A tenant who uses one transport, and what it saw."""

import hashlib
import re
from collections.abc import Mapping
from typing import Any

from contract_outcome import Outcome
from contract_transports import Transport, bearer

from fvs_schema.scenes import ScenePage

_ID = re.compile(r"\b(scn|job|snp|rnk|pln|key|req|whk)_[0-9a-z]{26}\b")
_TIME = re.compile(r"^\d{4}-\d\d-\d\dT")
_MEASURED = frozenset({"seconds", "waited_s", "heartbeat_age_s", "delivered", "secret"})
_OPAQUE = frozenset({"etag", "next"})


class Tenant:
    """A tenant who uses one transport; what it saw is kept in ``seen``, in a form that can be compared."""

    def __init__(self, gateway: Any, transport: Transport, name: str) -> None:
        self.gateway, self.transport, self.name = gateway, transport, name
        self.key: str | None = self.new_key()
        self.seen: list[tuple[str, Any]] = []
        self._ids: dict[str, str] = {}

    def new_key(self, **options: Any) -> str:
        created: str = self.gateway.application.storage.keys.create("test", tenant_id=self.name, **options)
        return created

    @property
    def headers(self) -> dict[str, str]:
        """The headers of a request that only REST has."""
        return bearer(self.key)

    def call(self, name: str, body: Any = None, /, **given: Any) -> Outcome:
        """Call an operation with the tenant's key, or with ``key``."""
        key = given.pop("key", self.key)
        return self._noted(name, self.transport.call(name, key, given, body))

    def upload(self, scene_id: str, content: bytes, digest: str | None = None, **metadata: Any) -> Outcome:
        """Send an image."""
        key = metadata.pop("key", self.key)
        digest = digest or f"sha256:{hashlib.sha256(content).hexdigest()}"
        return self._noted("UploadImage", self.transport.upload(key, scene_id, digest, content, metadata))

    def download(self, name: str, start: int = 0, /, **given: Any) -> Outcome:
        """Fetch a download's bytes from ``start`` on, by its name and parameters."""
        return self._noted(name, self.transport.download(name, self.key, given, start))

    def scene(self, **request: Any) -> str:
        """A new scene's id."""
        made = self.call("CreateScene", {"name": "a scene", **request})
        assert not made.code, made
        return str(made.result["id"])

    def leave(self) -> None:
        """Delete all scenes."""
        app = self.gateway.application
        caller = app.storage.keys.authenticate(self.key)
        for scene in app.scenes.all(caller, ScenePage()).items:
            app.deletions.scene(caller, scene.id)

    def _noted(self, name: str, outcome: Outcome) -> Outcome:
        shown = Outcome(
            result=self._comparable(outcome.result),
            code=outcome.code,
            retryable=outcome.retryable,
            message=self._comparable(outcome.message),
            fields=outcome.fields,
            retry_after=outcome.retry_after,
        )
        self.seen.append((name, shown))
        return outcome

    def _comparable(self, value: Any) -> Any:
        """A value without what differs from call to call: ids, times, durations, cursors."""
        if isinstance(value, Mapping):
            return {
                name: 0.0
                if name in _MEASURED
                else part is not None
                if name in _OPAQUE
                else self._comparable(part)
                for name, part in value.items()
            }
        if isinstance(value, list | tuple):
            return [self._comparable(part) for part in value]
        if isinstance(value, str):
            if _TIME.match(value):
                return "a time"
            return _ID.sub(
                lambda found: self._ids.setdefault(found[0], f"{found[1]} {len(self._ids)}"), value
            )
        return value
