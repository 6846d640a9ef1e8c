"""Photographs as cameras and autopilots report them: each once, and those whose report was lost, too."""

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, NamedTuple

_MOST_MISSING = 100
"""Maximum number of reports that are requested at once."""
_AUTOPILOT = 1
"""``MAV_COMP_ID_AUTOPILOT1``."""
_VIDEO = 1
"""``CAMERA_FEEDBACK_VIDEO``."""


class Source(NamedTuple):
    """Who reports photographs, and numbers them by itself: a message of a camera of a component."""

    message: str
    component: int = 0
    camera: int = 0

    @property
    def is_folder(self) -> bool:
        """Whether it is the folder that files come into."""
        return self == FOLDER


FOLDER = Source("file")


@dataclass(frozen=True)
class Capture:
    """A photograph that was reported; ``file`` is its name, empty where the source knows none."""

    number: int
    """Counts the photographs of the ``source``."""
    succeeded: bool
    file: str
    place: tuple[float, float] | None = None
    """Latitude and longitude in degrees; None when the source does not know."""
    altitude_m: float = math.nan
    height_m: float = math.nan
    """Above home."""
    source: Source = FOLDER
    time_s: float | None = None
    """When it was taken, on a clock of the source; None when the source does not know."""


@dataclass
class _Numbers:
    """The numbers of one camera's ``CAMERA_IMAGE_CAPTURED``."""

    next: int | None = None
    """The number of the next photograph; None as long as it is not known."""
    since_ms: int = 0
    """The camera's clock at the beginning: it may report earlier photographs, but they are not ours."""
    asked: set[int] = field(default_factory=set)


class Captures:
    """Collects reports of all sources. Where numbers are left out that can be requested, ``ask`` gets those.

    Cameras number ``CAMERA_IMAGE_CAPTURED`` from 0 and repeat it on request; autopilots number
    ``CAMERA_FEEDBACK`` from 1 and do not.
    """

    def __init__(self, ask: Callable[[int], None]) -> None:
        self._ask = ask
        self._new: list[Capture] = []
        self._seen: set[tuple[Source, int, int]] = set()
        self._numbers: dict[int, _Numbers] = {}
        """Those of each component."""

    def take(self) -> list[Capture]:
        """The photographs reported since the last call."""
        found, self._new = self._new, []
        return found

    def add(self, message: Any, home_m: float = math.nan) -> None:
        """Record a ``CAMERA_IMAGE_CAPTURED``; duplicates are ignored. ``home_m`` is the altitude of home.

        PX4 itself reports no height above home, but above the ground, or -1 m.
        """
        source = Source("image", message.get_srcComponent(), message.camera_id)
        numbers = self._of(source.component)
        number = message.image_index
        if self._is_known(source, number, message.time_boot_ms):
            return
        if number in numbers.asked and message.time_boot_ms < numbers.since_ms:
            return
        url = message.file_url
        text = url.decode(errors="replace") if isinstance(url, bytes) else url
        above_home_m = message.relative_alt / 1e3
        if source.component == _AUTOPILOT:
            above_home_m = message.alt / 1e3 - home_m
        self._new.append(
            Capture(
                number,
                message.capture_result == 1,
                text.rstrip("\0").rpartition("/")[2],
                _place(message.lat, message.lon),
                message.alt / 1e3,
                above_home_m,
                source,
                message.time_boot_ms / 1e3,
            )
        )
        if numbers.next is None or number >= numbers.next:
            self._ask_before(numbers, number)
            numbers.next = number + 1

    def add_feedback(self, message: Any) -> None:
        """Record a ``CAMERA_FEEDBACK``, which says that the autopilot triggered; duplicates are ignored."""
        source = Source("feedback", message.get_srcComponent(), message.cam_idx)
        if message.flags == _VIDEO or self._is_known(source, message.img_idx, message.time_usec):
            return
        self._new.append(
            Capture(
                message.img_idx,
                True,
                "",
                _place(message.lat, message.lng),
                message.alt_msl,
                message.alt_rel,
                source,
                message.time_usec / 1e6,
            )
        )

    def are(self, component: int, count: int, time_ms: int) -> None:
        """Record the number of all photographs and the time of a ``CAMERA_CAPTURE_STATUS``."""
        numbers = self._of(component)
        if numbers.next is None or count < numbers.next:  # the first time, or it was switched on again
            self._numbers[component] = _Numbers(count, time_ms)
        else:
            self._ask_before(numbers, count)

    def _of(self, component: int) -> _Numbers:
        return self._numbers.setdefault(component, _Numbers())

    def _is_known(self, source: Source, number: int, time: int) -> bool:
        """Whether this report came before."""
        key = (source, number, time)
        known = key in self._seen
        self._seen.add(key)
        return known

    def _ask_before(self, numbers: _Numbers, end: int) -> None:
        """Request the missing reports before number ``end``."""
        if numbers.next is None:
            return
        for number in range(numbers.next, min(end, numbers.next + _MOST_MISSING)):
            numbers.asked.add(number)
            self._ask(number)


def _place(latitude: int, longitude: int) -> tuple[float, float] | None:
    """A position in degrees, from degrees times 1e7; None for zeros, where it is not known."""
    return None if latitude == longitude == 0 else (latitude / 1e7, longitude / 1e7)
