"""The photographs of a flight: a spool in a thread sends them while the vehicle flies on."""

import threading
import time
from collections.abc import Callable
from pathlib import Path

from fvs_client.spool import Outbox, Settings, Spool, State
from fvs_client.spool.outbox import FILE_NAME

_LOOK_S = 0.2


class Photographs:
    """Sends what a camera writes into ``folder``; a context manager.

    Entering it raises ``SpoolError`` when the spool cannot work: another process sends from the folder.
    """

    def __init__(
        self,
        folder: Path,
        scene_id: str,
        *,
        url: str,
        api_key: str | None,
        say: Callable[[str], None],
        settings: Settings | None = None,
    ) -> None:
        self._path = folder / FILE_NAME
        settings = settings or Settings(settle_s=0.5, look_every_s=0.3)
        self._spool = Spool(folder, scene_id, url=url, api_key=api_key, settings=settings, say=say)
        self._thread = threading.Thread(target=self._run, name="spool", daemon=True)
        self._failure: BaseException | None = None
        self._begun = threading.Event()

    def __enter__(self) -> "Photographs":
        self._thread.start()
        self._begun.wait()
        if self._failure is not None:
            raise self._failure
        return self

    def __exit__(self, *_: object) -> None:
        self._spool.stop()
        self._thread.join()

    @property
    def sent(self) -> int:
        """How many photographs the service has acknowledged; raises what ended the spool."""
        return self._counts().get(State.SENT, 0)

    @property
    def left(self) -> int:
        """How many photographs wait or are being sent."""
        counts = self._counts()
        return counts.get(State.WAITING, 0) + counts.get(State.SENDING, 0)

    def wait(self, count: int, timeout_s: float, give_up: Callable[[], bool] = lambda: False) -> bool:
        """Wait until ``count`` photographs were sent or refused; False when the time is over."""
        until = time.monotonic() + timeout_s
        while True:
            counts = self._counts()
            if counts.get(State.SENT, 0) + counts.get(State.REFUSED, 0) >= count:
                return True
            if time.monotonic() >= until or give_up():
                return False
            time.sleep(_LOOK_S)

    def _counts(self) -> dict[State, int]:
        if self._failure is not None:
            raise self._failure
        if not self._path.exists():
            return {}
        with Outbox(self._path, create=False) as outbox:
            return outbox.counts()

    def _run(self) -> None:
        try:
            self._spool.run(self._begun.set)
        except BaseException as error:  # it must not end unseen
            self._failure = error
        finally:
            self._begun.set()
