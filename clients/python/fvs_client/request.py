"""A request of the client, as data, and a file as its body."""

import uuid
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

REQUEST_ID = "X-Request-Id"


@dataclass
class FileBody:
    """A file as the body of a request, read while it is sent; ``on_bytes`` gets the size of each sent chunk.

    When the request is sent again, ``on_bytes`` first gets minus the number of bytes sent before.
    """

    path: Path
    size_bytes: int
    on_bytes: Callable[[int], None]
    sent_bytes: int = 0

    def restart(self) -> None:
        """Send the file from its beginning."""
        if self.sent_bytes:
            self.on_bytes(-self.sent_bytes)
            self.sent_bytes = 0

    def advance(self, size_bytes: int) -> None:
        """Count a chunk that was sent."""
        self.sent_bytes += size_bytes
        self.on_bytes(size_bytes)


@dataclass(frozen=True)
class Request:
    """One request."""

    method: str
    path: str
    params: Mapping[str, Any] = field(default_factory=dict)
    headers: Mapping[str, str] = field(default_factory=dict)
    document: Mapping[str, Any] | None = None
    """Sent as JSON."""
    body: bytes | FileBody | None = None
    repeatable: bool = True
    """Whether sending it twice has the effect of sending it once."""
    read_timeout_s: float | None = None
    """Replaces the client's own read timeout."""

    def identified(self) -> "Request":
        """The request with an ``X-Request-Id``, by which the service's log can be searched."""
        return replace(self, headers={REQUEST_ID: f"req_{uuid.uuid4().hex}", **self.headers})
