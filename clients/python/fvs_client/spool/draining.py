"""Send the photographs that wait in an outbox, for as long as it takes."""

import random
import sqlite3
import threading
from collections.abc import Callable

from fvs_client.spool.connection import Connection, Target
from fvs_client.spool.deleting import Room
from fvs_client.spool.errors import LinkError, card_is_full
from fvs_client.spool.outbox import Outbox
from fvs_client.spool.pace import Pace
from fvs_client.spool.photograph import Photograph, Refusal
from fvs_client.spool.resumable import PutOffError, ResumableCarrier
from fvs_client.spool.sending import Sender
from fvs_client.spool.settings import Settings


class Drain:
    """Sends the photographs of an outbox, one at a time: a link that is slow has no room for two."""

    def __init__(
        self, outbox: Outbox, target: Target, settings: Settings, say: Callable[[str], None]
    ) -> None:
        self._outbox, self._settings, self._say = outbox, settings, say
        self._connection = Connection(target, Pace(settings.max_rate_bytes_s), settings.timeout_s)
        carrier = ResumableCarrier(self._connection, outbox, self._puts_off)
        self._sender = Sender(outbox, self._connection, carrier)
        self._backoff = Backoff(settings.first_pause_s, settings.longest_pause_s)
        self._room = Room(outbox, settings, say)
        self._trouble: str | None = None
        self._outbox_gone = False

    def run(self, stop: threading.Event, *, until_empty: bool) -> None:
        """Send until ``stop``, or until nothing waits. A link that fails is retried forever."""
        self._outbox.set_trouble(None)
        try:
            while not stop.is_set():
                self._look_for_outbox()
                self._room.make()
                photograph = self._outbox.next(newest_first=self._settings.newest_first)
                if photograph is not None:
                    stop.wait(self._try_on_card(photograph))
                elif until_empty:
                    return
                else:
                    stop.wait(self._settings.look_every_s)
        finally:
            self._connection.close()

    def _look_for_outbox(self) -> None:
        """Warn once when the outbox was deleted: it still works, but ends with this process."""
        gone = not self._outbox.in_place()
        if gone and not self._outbox_gone:
            self._say(
                f"{self._outbox.path} was deleted or replaced. Sending continues, but `status` "
                "does not see it. Start again when the folder is back: no photograph is stored twice."
            )
        self._outbox_gone = gone

    def _try_on_card(self, photograph: Photograph) -> float:
        """Send a photograph; returns how long to wait in s before the next try."""
        try:
            return self._try(photograph)
        except sqlite3.OperationalError as error:
            if not card_is_full(error):
                raise
            self._warn("The card is full: acknowledgements cannot be recorded. Waiting for room.")
            return self._backoff.pause_s()

    def _try(self, photograph: Photograph) -> float:
        try:
            refusal = self._sender.send(photograph)
        except LinkError as error:
            return self._failed(photograph, error)
        except PutOffError:
            return 0.0
        self._worked()
        self._report(photograph, refusal)
        return 0.0

    def _puts_off(self, photograph: Photograph) -> bool:
        """Whether a newer photograph goes first: on a slow link this one may take minutes."""
        if not self._settings.newest_first:
            return False
        following = self._outbox.next(newest_first=True)
        return following is not None and following.number > photograph.number

    def _failed(self, photograph: Photograph, error: LinkError) -> float:
        now = self._outbox.get(photograph.number)
        if now.offset_bytes > photograph.offset_bytes:
            self._backoff.reset()
        elif error.answered:
            self._outbox.set_back(photograph.number)
        pause_s = self._backoff.pause_s(error.retry_after_s)
        if self._warn(" ".join(filter(None, (str(error), error.hint)))):
            self._outbox.set_trouble(str(error), error.hint)
        return pause_s

    def _worked(self) -> None:
        self._backoff.reset()
        if self._trouble is not None:
            self._outbox.set_trouble(None)
        self._trouble = None

    def _report(self, photograph: Photograph, refusal: Refusal | None) -> None:
        if refusal is None:
            self._say(f"{photograph.name}: sent ({photograph.size_bytes / 1e6:,.1f} MB)")
        else:
            self._say(f"{photograph.name}: refused. {refusal.reason} {refusal.hint}".rstrip())

    def _warn(self, trouble: str) -> bool:
        """Warn of a trouble once; returns whether it is new."""
        news = trouble != self._trouble
        if news:
            self._say(f"{trouble} Trying again.")
        self._trouble = trouble
        return news


class Backoff:
    """Pauses with full jitter: uniform between 0 and ``first_s`` · 2ⁿ, at most ``longest_s``.

    Devices that lost the same link do not return together. A ``Retry-After`` is added.
    """

    def __init__(self, first_s: float, longest_s: float, draw: Callable[[], float] = random.random) -> None:
        self._first_s, self._longest_s, self._draw = first_s, longest_s, draw
        self._failures = 0

    def pause_s(self, retry_after_s: float = 0.0) -> float:
        """The pause in s after one more failure."""
        longest = min(self._longest_s, self._first_s * 2.0 ** min(self._failures, 32))
        self._failures += 1
        return self._draw() * longest + retry_after_s

    def reset(self) -> None:
        """The link works again."""
        self._failures = 0
