"""Watch a folder, and take its photographs once they are complete."""

import sqlite3
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from fvs_client.spool.errors import card_is_full
from fvs_client.spool.folder import FoundFile, find_files
from fvs_client.spool.metadata import Describe
from fvs_client.spool.outbox import Outbox
from fvs_client.spool.photograph import Photograph
from fvs_client.spool.taking import take
from fvs_client.spool.wholeness import is_whole

_REST_PER_LISTING = 20.0
_TELL_AFTER_S = 60.0
"""A file that has not changed for so long and has no end is worth a word."""


@dataclass(slots=True)
class _Seen:
    """A file in the folder: since when, on the monotonic clock, it has been as it is."""

    file: FoundFile
    since_s: float
    taken: bool = False
    told: bool = False


class Watcher:
    """Looks at a folder again and again; each look takes what has become complete.

    Complete: neither file nor sidecar has changed for ``settle_s``, and the file has its format's end.
    """

    def __init__(
        self,
        folder: Path,
        scene: str,
        outbox: Outbox,
        *,
        settle_s: float,
        say: Callable[[str], None],
        describe: Describe | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._folder, self._scene, self._outbox = folder, scene, outbox
        self._settle_s = settle_s
        self._say = say
        self._describe = describe
        self._clock = clock
        self._seen: dict[str, _Seen] = {}
        self._troubles: set[str] = set()
        self.rest_s = 0.0
        """How long to wait before the next look, so that looks take a twentieth of a processor at most."""

    def look(self) -> list[Photograph]:
        """Look once, and return what was taken. What cannot be read is tried at the next look."""
        now = self._clock()
        troubles: set[str] = set()

        def skip(error: OSError) -> None:
            self._tell(f"{error.filename} cannot be read: {error.strerror}. It is skipped.", troubles)

        try:
            files = find_files(self._folder, skip)
            self.rest_s = _REST_PER_LISTING * (self._clock() - now)
        except OSError as error:
            self._tell(f"{self._folder} cannot be read: {error.strerror}. Waiting for it.", troubles)
            self._troubles = troubles
            return []
        before, self._seen = self._seen, {}
        for file in files:
            known = before.get(file.location)
            same = known is not None and known.file == file
            self._seen[file.location] = known if known is not None and same else _Seen(file, now)
        taken: list[Photograph] = []
        for seen in self._seen.values():
            if not seen.taken:
                try:
                    if (photograph := self._take(seen, now)) is not None:
                        taken.append(photograph)
                except (OSError, sqlite3.OperationalError) as error:
                    self._tell(_describe_failure(seen.file.path, error), troubles)
                    if card_is_full(error):
                        break
        self._troubles = troubles
        return taken

    def _take(self, seen: _Seen, now: float) -> Photograph | None:
        file = seen.file
        if self._outbox.has(file.path, self._scene, file.size_bytes, file.mtime_ns, file.sidecar_state):
            seen.taken = True
            return None
        unchanged_s = now - seen.since_s
        if unchanged_s < self._settle_s:
            return None
        if not is_whole(file.path):
            if unchanged_s >= _TELL_AFTER_S and not seen.told:
                seen.told = True
                self._say(
                    f"{file.path.name} has no end and has not changed for {_TELL_AFTER_S:.0f} s: did the "
                    "camera lose power? It stays, and is sent once it is whole."
                )
            return None
        photograph = take(self._outbox, file, self._scene, self._describe, durable=False)
        seen.taken = True
        if photograph.refusal is not None:
            self._say(f"{file.path.name} is not sent. {photograph.refusal.reason} {photograph.refusal.hint}")
        return photograph

    def _tell(self, trouble: str, troubles: set[str]) -> None:
        """Add to the troubles of this look, and say what the last one did not have."""
        if trouble not in self._troubles | troubles:
            self._say(trouble)
        troubles.add(trouble)


def _describe_failure(path: Path, error: OSError | sqlite3.OperationalError) -> str:
    if card_is_full(error):
        return (
            f"The card is full: {path.name} waits in its folder, and is taken when there is room. "
            "--delete-sent makes room from photographs that the service has."
        )
    return f"{path.name} cannot be taken now: {error}. It is tried again."
