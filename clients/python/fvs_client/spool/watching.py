"""Watch a folder, and take its photographs once they are complete."""

import sqlite3
import time
from collections.abc import Callable, Container, Iterator, Mapping
from heapq import nsmallest
from math import inf
from pathlib import Path

from fvs_client.spool.errors import card_is_full
from fvs_client.spool.folder import FoundFile, each_file, order_of
from fvs_client.spool.metadata import Describe
from fvs_client.spool.outbox import CUT_OFF, Outbox
from fvs_client.spool.photograph import Photograph, Refusal
from fvs_client.spool.taking import take
from fvs_client.spool.wholeness import is_whole

Refuse = Callable[[Path], Refusal | None]
"""Why a file is not to be sent; None where it is."""

_REST_PER_LISTING = 20.0
_CUT_OFF_AFTER_S = 60.0
"""Time without a change after which a file without an end is refused, until it changes."""
_CUT_OFF = Refusal(
    CUT_OFF,
    f"It is empty or has no end, and did not change for {_CUT_OFF_AFTER_S:.0f} s: did the camera lose power?",
    "It stays, and is sent when it is whole; `fvs-client spool retry` sends it as it is.",
)
_MOST_PER_LOOK = 500
"""Maximum number of files taken per scan; only a hash of each other file is kept in memory."""


class Watcher:
    """Scans a folder regularly; each scan takes the files that have become complete.

    Complete: neither file nor sidecar has changed for ``settle_s``, and the file has its format's end. One
    that stays without is refused: it can be seen in the outbox, and is taken when it has changed.
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
        refuse: Refuse | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._folder, self._scene, self._outbox = folder, scene, outbox
        self._settle_s = settle_s
        self._say = say
        self._describe, self._refuse = describe, refuse
        self._clock = clock
        # Files, as they are, by their hashes: a folder may have more of them than there is memory for.
        self._known: set[int] = set()
        self._waiting: dict[int, float] = {}
        """When each file was last seen to change, on the monotonic clock."""
        self._tried: dict[int, float] = {}
        """When those that could not be taken were last tried."""
        self._troubles: set[str] = set()
        self.rest_s = 0.0
        """How long to wait before the next look, so that looks take a twentieth of a processor at most."""

    def look(self) -> list[Photograph]:
        """Look once, and return what was taken: the first 500 files that are complete."""
        now = self._clock()
        troubles: set[str] = set()
        known, waiting = self._known, self._waiting
        self._known, self._waiting = set(), {}
        try:
            complete = self._complete(now, known, waiting, troubles)
            chosen = nsmallest(_MOST_PER_LOOK, complete, key=self._turn)
        except OSError as error:
            self._warn(f"{self._folder} cannot be read: {error.strerror}. Waiting for it.", troubles)
            self._troubles, self._known, self._waiting = troubles, known, waiting
            return []
        if self._known <= known and self._waiting.keys() <= waiting.keys():  # what is new takes longer, once
            self.rest_s = _REST_PER_LISTING * (self._clock() - now)
        taken: list[Photograph] = []
        for file in chosen:
            try:
                if (photograph := self._take(file, now)) is not None:
                    taken.append(photograph)
            except (OSError, sqlite3.OperationalError) as error:
                self._tried[hash(file)] = now
                self._warn(_describe_failure(file.path, error), troubles)
                if card_is_full(error):
                    break
        if len(taken) == _MOST_PER_LOOK:
            self.rest_s = 0.0
        self._tried = {mark: at for mark, at in self._tried.items() if mark in self._waiting}
        self._troubles = troubles
        return taken

    def _complete(
        self, now: float, known: Container[int], waiting: Mapping[int, float], troubles: set[str]
    ) -> Iterator[FoundFile]:
        """The files that have settled and are new; records all others as ``known`` or ``waiting``."""

        def skip(error: OSError) -> None:
            self._warn(f"{error.filename} cannot be read: {error.strerror}. It is skipped.", troubles)

        for file in each_file(self._folder, skip):
            mark = hash(file)
            if mark in known or (mark not in waiting and self._is_known(file)):
                self._known.add(mark)
                continue
            since = self._waiting[mark] = waiting.get(mark, now)
            if now - since >= self._settle_s:
                yield file

    def _turn(self, file: FoundFile) -> tuple[float, list[tuple[int, str]]]:
        """Sorts files by their numbers; those that could not be taken come last."""
        return self._tried.get(hash(file), -inf), order_of(file)

    def _is_known(self, file: FoundFile) -> bool:
        try:
            return self._outbox.has(
                file.path, self._scene, file.size_bytes, file.mtime_ns, file.sidecar_state
            )
        except sqlite3.OperationalError:  # asked again when it is taken
            return False

    def _take(self, file: FoundFile, now: float) -> Photograph | None:
        mark, whole = hash(file), is_whole(file.path)
        if not whole and now - self._waiting[mark] < _CUT_OFF_AFTER_S:
            self._tried[mark] = now
            return None
        refusal = None if self._refuse is None else self._refuse(file.path)
        if refusal is None and not whole:
            refusal = _CUT_OFF
        photograph = take(self._outbox, file, self._scene, self._describe, refusal=refusal, durable=False)
        del self._waiting[mark]
        self._known.add(mark)
        if photograph.refusal is not None:
            self._say(f"{file.path.name} is not sent. {photograph.refusal.reason} {photograph.refusal.hint}")
        return photograph

    def _warn(self, trouble: str, troubles: set[str]) -> None:
        """Add to the troubles of this look, and report those that the last one did not have."""
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
