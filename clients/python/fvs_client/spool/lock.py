"""One process at a time sends from an outbox."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from fvs_client.spool.errors import SpoolError


@contextmanager
def only_sender(outbox: Path) -> Iterator[None]:
    """Hold the right to send from an outbox; it ends with the process. Raises ``SpoolError``."""
    # Not the outbox itself: SQLite loses its locks on a file when the process closes another handle of it.
    try:
        with outbox.with_name(f"{outbox.name}-lock").open("w") as lock:
            try:
                _lock(lock)
            except BlockingIOError:
                raise SpoolError(
                    f"Another process sends from {outbox}.",
                    hint="Probably `fvs-client spool watch`; `fvs-client spool status` shows its work.",
                ) from None
            yield
    except OSError as error:
        raise SpoolError(
            f"{outbox.parent} cannot be written to: {error.strerror}.",
            hint="Is it there, has it room, may this user write to it? --outbox puts the outbox elsewhere.",
        ) from error


def has_sender(outbox: Path) -> bool:
    """Whether a process sends from the outbox now."""
    try:
        with outbox.with_name(f"{outbox.name}-lock").open("r") as lock:
            _lock(lock)
    except BlockingIOError:
        return True
    except OSError:
        return False
    return False


def _lock(file: TextIO) -> None:
    try:
        import fcntl
    except ImportError as error:  # the other commands run on Windows, too
        raise SpoolError("The spool runs on Linux and macOS only.") from error
    fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
