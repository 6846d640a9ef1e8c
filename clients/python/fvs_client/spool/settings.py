"""The settings of a spool."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Settings:
    """How a spool takes and sends photographs."""

    newest_first: bool = False
    """Send the newest photograph next, instead of the oldest."""
    max_rate_bytes_s: float | None = None
    """Bytes of photographs per second at most."""
    delete_sent: bool = False
    """Delete files of photographs that the service has acknowledged; only then are files deleted at all."""
    max_disk_bytes: int | None = None
    """With ``delete_sent``: delete only what exceeds this, the oldest first. Alone: only warn."""
    settle_s: float = 2.0
    """A file is complete when its size and time have not changed for so long."""
    look_every_s: float = 1.0
    """How often the folder and the outbox are looked at."""
    timeout_s: float = 30.0
    """After so long without a byte a connection counts as broken."""
    first_pause_s: float = 0.5
    """The longest pause after the first failure; it doubles with each one in a row."""
    longest_pause_s: float = 60.0
    """The longest pause after a failure; a ``Retry-After`` of the service is added."""
