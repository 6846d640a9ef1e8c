"""Failures of a spool: of itself, and of its link."""

import errno
import shutil
import sqlite3
from pathlib import Path

_NO_ROOM = frozenset({errno.ENOSPC, errno.EDQUOT})
_SMALLEST_ROOM_BYTES = 1 << 19
"""Room that suffices for SQLite's files beside the outbox."""


class SpoolError(Exception):
    """The spool cannot work: ``str(error)`` says why, ``hint`` what to do about it."""

    def __init__(self, message: str, *, hint: str = "") -> None:
        super().__init__(message)
        self.hint = hint


class LinkError(Exception):
    """The service was not reached, or could not answer: the same request succeeds later.

    ``answered``: the service, or something before it, answered; ``retry_after_s``: what it asked to wait.
    """

    def __init__(
        self, message: str, *, hint: str = "", answered: bool = False, retry_after_s: float = 0.0
    ) -> None:
        super().__init__(message)
        self.hint = hint
        self.answered = answered
        self.retry_after_s = retry_after_s


def card_is_full(error: BaseException) -> bool:
    """Whether a card or disk has no room left."""
    if isinstance(error, sqlite3.Error):
        return getattr(error, "sqlite_errorcode", 0) & 0xFF == sqlite3.SQLITE_FULL
    return isinstance(error, OSError) and error.errno in _NO_ROOM


def _has_no_room(folder: Path) -> bool:
    try:
        return shutil.disk_usage(folder).free < _SMALLEST_ROOM_BYTES
    except OSError:
        return False


def unusable(path: Path, error: sqlite3.Error) -> SpoolError:
    """The error for an outbox that SQLite cannot use."""
    if card_is_full(error) or _has_no_room(path.parent):  # SQLite often only says that it cannot write
        return SpoolError(
            f"There is no room for {path}.",
            hint="The card is full: delete something from it, or put the outbox elsewhere with --outbox.",
        )
    code = getattr(error, "sqlite_errorcode", 0) & 0xFF
    if code in (sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB):
        return SpoolError(
            f"{path} is damaged: {error}.",
            hint="Move it, its -wal and its -shm away and start again: no photograph is stored twice.",
        )
    return SpoolError(
        f"{path} cannot be used: {error}.",
        hint="Is its folder there, and may this user write to it? --outbox puts it elsewhere.",
    )
