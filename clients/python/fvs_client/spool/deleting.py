"""Delete photographs that the service has acknowledged, if that was requested."""

import time
from collections.abc import Callable, Iterator
from pathlib import Path

from fvs_client.spool.outbox import Outbox
from fvs_client.spool.photograph import Photograph
from fvs_client.spool.settings import Settings
from fvs_client.spool.taking import digest_of

_TRY_AGAIN_S = 60.0
"""A file that cannot be deleted is not read again sooner."""


class Room:
    """Keeps the photographs of an outbox within their disk space."""

    def __init__(
        self,
        outbox: Outbox,
        settings: Settings,
        say: Callable[[str], None],
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._outbox, self._settings, self._say, self._clock = outbox, settings, say, clock
        self._warned = False
        self._failed_at: dict[int, float] = {}
        """When files, by their numbers, could not be deleted."""

    def make(self) -> None:
        """Delete sent photographs, the oldest first, as far as the limit requires."""
        most = self._settings.max_disk_bytes
        kept = self._outbox.kept_bytes()
        if self._settings.delete_sent and (most is None or kept > most):
            for photograph in self._deletable():
                if most is not None and kept <= most:
                    break
                kept -= self._delete(photograph)
        if most is None or kept <= most:
            self._warned = False
        elif not self._warned:
            self._warned = True
            why = "None of them is deleted before the service has accepted it."
            if not self._settings.delete_sent:
                why = "Nothing is deleted without --delete-sent."
            self._say(f"The photographs take {kept / 1e6:,.1f} MB, more than {most / 1e6:,.1f} MB. {why}")

    def _deletable(self) -> Iterator[Photograph]:
        last = 0
        while found := self._outbox.deletable(after=last):
            yield from found
            last = found[-1].number

    def _delete(self, photograph: Photograph) -> int:
        """Delete the file if its bytes are those that were acknowledged. Return the bytes freed."""
        path, number = photograph.path, photograph.number
        failed_at = self._failed_at.get(number)
        if failed_at is not None and self._clock() - failed_at < _TRY_AGAIN_S:
            return 0
        freed = photograph.size_bytes
        try:
            before = _identity(path)
            if digest_of(path) != photograph.digest:
                freed = 0
            elif _identity(path) == before:
                path.unlink()
            else:  # written to meanwhile: it is looked at again
                return 0
        except FileNotFoundError:
            pass
        except OSError as error:
            if failed_at is None:
                self._say(f"{path} cannot be deleted: {error.strerror}. It is tried again.")
            self._failed_at[number] = self._clock()
            return 0
        self._failed_at.pop(number, None)
        # A file with other bytes now is another photograph, which the outbox has by its own digest.
        self._outbox.set_deleted(photograph)
        return freed


def _identity(path: Path) -> tuple[int, ...]:
    """The identity of a file, which changes when it is replaced or written to. Raises ``OSError``."""
    status = path.stat()
    return status.st_dev, status.st_ino, status.st_size, status.st_mtime_ns, status.st_ctime_ns
