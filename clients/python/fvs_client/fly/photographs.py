"""The photographs of a flight: a spool in a thread sends them while the vehicle flies on."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fvs_client.spool import Outbox, Settings, Spool, State
from fvs_client.spool.folder import each_file
from fvs_client.spool.outbox import FILE_NAME

_LOOK_S = 0.2


class Photographs:
    """Sends the photographs that a camera writes into ``folder``; a context manager.

    The folder may have photographs of earlier flights. They are sent, too, and are not waited for.

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
        self._folder, self._scene_id = folder, scene_id
        self._path = folder / FILE_NAME
        self._earlier: frozenset[Path] = frozenset()
        """The files that were in the folder before this flight."""
        self._last_number = 0
        """The number of the newest photograph before this flight."""
        settings = settings or Settings(settle_s=0.5, look_every_s=0.3)
        self._spool = Spool(folder, scene_id, url=url, api_key=api_key, settings=settings, say=say)
        self._thread = threading.Thread(target=self._run, name="spool", daemon=True)
        self._failure: BaseException | None = None
        self._begun = threading.Event()

    def __enter__(self) -> "Photographs":
        self._earlier = frozenset(map(_place, (file.path for file in each_file(self._folder))))
        if self._path.exists():
            with Outbox(self._path, create=False) as outbox:
                self._last_number = outbox.last_number()
        self._thread.start()
        self._begun.wait()
        if self._failure is not None:
            raise self._failure
        return self

    def __exit__(self, *_: object) -> None:
        self._spool.stop()
        self._thread.join()

    @property
    def left(self) -> int:
        """How many photographs in the folder wait or are being sent, also those of earlier flights."""
        with self._outbox() as outbox:
            counts = {} if outbox is None else outbox.counts()
        return counts.get(State.WAITING, 0) + counts.get(State.SENDING, 0)

    def wait(self, count: int, timeout_s: float, give_up: Callable[[], bool] = lambda: False) -> bool:
        """Wait until ``count`` photographs of this flight were sent or refused; False when the time is over.

        Raises what ended the spool.
        """
        until = time.monotonic() + timeout_s
        while self._ended() < count:
            if time.monotonic() >= until or give_up():
                return False
            time.sleep(_LOOK_S)
        return True

    def _ended(self) -> int:
        """Number of this flight's photographs that were sent or refused."""
        with self._outbox() as outbox:
            added = () if outbox is None else outbox.added_after(self._last_number)
        return sum(
            photograph.state in (State.SENT, State.REFUSED)
            and photograph.scene == self._scene_id
            and _place(photograph.path) not in self._earlier
            for photograph in added
        )

    @contextmanager
    def _outbox(self) -> Iterator[Outbox | None]:
        """The outbox, None before it exists; raises what ended the spool."""
        if self._failure is not None:
            raise self._failure
        if not self._path.exists():
            yield None
            return
        with Outbox(self._path, create=False) as outbox:
            yield outbox

    def _run(self) -> None:
        try:
            self._spool.run(self._begun.set)
        except BaseException as error:  # it must not end unseen
            self._failure = error
        finally:
            self._begun.set()


def _place(path: Path) -> Path:
    return path.parent.resolve() / path.name
