"""The photographs of a flight: a spool in a thread sends them while the vehicle flies on."""

import threading
import time
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from fvs_client.fly.captures import Capture
from fvs_client.spool import Outbox, Photograph, Refusal, Settings, Spool, State
from fvs_client.spool.folder import each_file
from fvs_client.spool.outbox import FILE_NAME, TEST
from fvs_client.spool.taking import UNSUPPORTED

_LOOK_S = 0.2
_TEST = Refusal(TEST, "It is the test photograph before takeoff.")


class _File(NamedTuple):
    """A file as it is: a camera that is switched on again may write the same names."""

    place: Path
    size_bytes: int
    mtime_ns: int

    @classmethod
    def of(cls, photograph: Photograph) -> "_File":
        return cls(_place(photograph.path), photograph.size_bytes, photograph.mtime_ns)


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
        self._earlier: frozenset[_File] = frozenset()
        """The files that were in the folder before this flight."""
        self._last_number = 0
        """The number of the newest photograph before this flight."""
        settings = settings or Settings(settle_s=0.5, look_every_s=0.3)
        self._known: dict[int, bool] = {}
        """Whether the photographs of this flight that ``arrived`` has returned were refused."""
        self._before_test: frozenset[_File] | None = None
        """The files that were in the folder before the test that goes on; None when none does."""
        self._tests: frozenset[Path] = frozenset()
        self._named: frozenset[str] = frozenset()
        """The names that reports gave to test photographs."""
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

        They are in the outbox then, and stay there until the service has them. Raw files, which it does not
        read, are none. Raises what ended the spool.
        """
        new = []
        for number, photograph in enumerate(filter(is_read, self._of_this_flight())):
            refused = photograph.state is State.REFUSED
            if self._known.get(photograph.number) is not refused:
                self._known[photograph.number] = refused
                new.append(_captured(number, photograph))
        return new

    def test(self) -> None:
        """What comes into the folder from now on is not sent: test photographs show the ground."""
        self._before_test = self._files()

    def begin(self) -> None:
        """What comes from now on is of the flight, unless a report has named it in a test."""
        if self._before_test is not None:
            self._tests |= {file.place for file in self._files() - self._before_test}
            self._before_test = None

    def tested(self, named: Collection[str] = ()) -> Photograph | None:
        """The newest test photograph, None before one; raises what ended the spool.

        A raw file is the last choice: the service does not read it. Those that reports have ``named`` may
        come late.
        """
        self._named |= set(named)
        tests = [one for one in self._added() if self._is_test(_place(one.path))]
        return max(tests, key=lambda one: (is_read(one), one.number), default=None)

    def _is_test(self, place: Path) -> bool:
        return place in self._tests or place.name in self._named

    def _refuse(self, path: Path) -> Refusal | None:
        place, before = _place(path), self._before_test
        if before is not None and _File(place, path.stat().st_size, path.stat().st_mtime_ns) not in before:
            self._tests |= {place}
        return _TEST if self._is_test(place) else None

    def _files(self) -> frozenset[_File]:
        return frozenset(
            _File(_place(file.path), file.size_bytes, file.mtime_ns) for file in each_file(self.folder)
        )

    def _added(self) -> list[Photograph]:
        """What was added to the outbox since the beginning."""
        with self._outbox() as outbox:
            return [] if outbox is None else outbox.added_after(self._last_number)

    def _of_this_flight(self) -> list[Photograph]:
        return [
            photograph
            for photograph in self._added()
            if photograph.scene == self._scene_id
            and not self._is_test(_place(photograph.path))
            and _File.of(photograph) not in self._earlier
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


def _captured(number: int, photograph: Photograph) -> Capture:
    """A file as a report, with the position of its sidecar. Its time may be that of a slow transfer."""
    latitude_deg, longitude_deg = (
        photograph.metadata.get(name) for name in ("latitude_deg", "longitude_deg")
    )
    place = None
    if isinstance(latitude_deg, float) and isinstance(longitude_deg, float):
        place = latitude_deg, longitude_deg
    return Capture(number, photograph.state is not State.REFUSED, photograph.path.name, place)


def is_read(photograph: Photograph) -> bool:
    """Whether the service reads its format."""
    return photograph.refusal is None or photograph.refusal.code != UNSUPPORTED


def _place(path: Path) -> Path:
    return path.parent.resolve() / path.name
