"""The photographs of a flight: a spool in a thread sends them while the vehicle flies on."""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from fvs_client.fly.captures import Capture
from fvs_client.spool import Outbox, Photograph, Refusal, Settings, Spool, State
from fvs_client.spool.folder import each_file
from fvs_client.spool.outbox import FILE_NAME, TEST

_LOOK_S = 0.2
_TEST = Refusal(TEST, "It is the test photograph before takeoff.")


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
        self.folder, self._scene_id = folder, scene_id
        self._path = folder / FILE_NAME
        self._earlier: frozenset[Path] = frozenset()
        """The files that were in the folder before this flight."""
        self._last_number = 0
        """The number of the newest photograph before this flight."""
        settings = settings or Settings(settle_s=0.5, look_every_s=0.3)
        self._known: dict[int, bool] = {}
        """Whether the photographs of this flight that ``arrived`` has returned were refused."""
        self._before_test: frozenset[Path] | None = None
        """The files that were in the folder before the test that goes on; None when none does."""
        self._tests: frozenset[Path] = frozenset()
        self._spool = Spool(
            folder, scene_id, url=url, api_key=api_key, settings=settings, refuse=self._refuse, say=say
        )
        self._thread = threading.Thread(target=self._run, name="spool", daemon=True)
        self._failure: BaseException | None = None
        self._begun = threading.Event()

    def __enter__(self) -> "Photographs":
        self._earlier = self._files()
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

    def arrived(self) -> list[Capture]:
        """The photographs of this flight that have come, or were refused, since the last call.

        They are in the outbox then, and stay there until the service has them. Raises what ended the spool.
        """
        new = []
        for photograph in self._of_this_flight():
            refused = photograph.state is State.REFUSED
            if self._known.get(photograph.number) is not refused:
                self._known[photograph.number] = refused
                new.append(_captured(photograph))
        return new

    @contextmanager
    def testing(self) -> Iterator[None]:
        """What comes into the folder meanwhile is not sent: test photographs show the ground."""
        self._before_test = self._files()
        try:
            yield
        finally:
            self._tests |= self._files() - self._before_test
            self._before_test = None

    def tested(self) -> str | None:
        """The name of the newest test photograph, None before one; raises what ended the spool."""
        names = [one.name for one in self._added() if _place(one.path) in self._tests]
        return names[-1] if names else None

    def _refuse(self, path: Path) -> Refusal | None:
        place, before = _place(path), self._before_test
        if before is not None and place not in before:
            self._tests |= {place}
        return _TEST if place in self._tests else None

    def _files(self) -> frozenset[Path]:
        return frozenset(_place(file.path) for file in each_file(self.folder))

    def _added(self) -> list[Photograph]:
        """What was added to the outbox since the beginning."""
        with self._outbox() as outbox:
            return [] if outbox is None else outbox.added_after(self._last_number)

    def _of_this_flight(self) -> list[Photograph]:
        return [
            photograph
            for photograph in self._added()
            if photograph.scene == self._scene_id
            and _place(photograph.path) not in self._earlier | self._tests
        ]

    def _ended(self) -> int:
        """Number of this flight's photographs that were sent or refused."""
        return sum(one.state in (State.SENT, State.REFUSED) for one in self._of_this_flight())

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


def _captured(photograph: Photograph) -> Capture:
    """A file as a report, with the position of its sidecar. Its time may be that of a slow transfer."""
    latitude_deg, longitude_deg = (
        photograph.metadata.get(name) for name in ("latitude_deg", "longitude_deg")
    )
    place = None
    if isinstance(latitude_deg, float) and isinstance(longitude_deg, float):
        place = latitude_deg, longitude_deg
    return Capture(photograph.number, photograph.state is not State.REFUSED, photograph.path.name, place)


def _place(path: Path) -> Path:
    return path.parent.resolve() / path.name
