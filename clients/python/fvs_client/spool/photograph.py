"""Records of photographs in an outbox."""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path


class State(StrEnum):
    """The state of a photograph in an outbox."""

    WAITING = "waiting"
    SENDING = "sending"
    """Sending has begun; after an interruption it resumes at its offset."""
    SENT = "sent"
    """The service has acknowledged its digest."""
    REFUSED = "refused"
    """It will not be sent, or cannot be used, for the reason that it has; the file stays."""


@dataclass(frozen=True)
class Refusal:
    """Why a photograph is not sent or cannot be used, and what to do about it."""

    code: str
    reason: str
    hint: str = ""


@dataclass(frozen=True)
class NewPhotograph:
    """A photograph that is taken into an outbox."""

    path: Path
    scene: str
    name: str
    digest: str
    """SHA-256 in hexadecimal."""
    size_bytes: int
    mtime_ns: int
    sidecar: str = ""
    """Which sidecar its metadata is from, by size and time; empty without one."""
    metadata: Mapping[str, object] | None = None
    """Fields of ``ImageMetadata`` as JSON has them."""
    refusal: Refusal | None = None
    """Why it is not sent at all."""


@dataclass(frozen=True)
class Photograph:
    """A photograph in an outbox."""

    number: int
    """Counts in the order of arrival."""
    path: Path
    scene: str
    name: str
    digest: str
    """SHA-256 in hexadecimal."""
    size_bytes: int
    mtime_ns: int
    metadata: Mapping[str, object]
    state: State
    upload: str | None
    """Id of its upload at the service, once that has begun."""
    offset_bytes: int
    """How much of it the service has, as far as is known."""
    setbacks: int
    """Answers in a row that were failures, without a byte of progress."""
    verdict: str | None
    """The service's verdict; None before there is one."""
    refusal: Refusal | None
    deleted: bool
    """The file was deleted here after it had been sent."""
