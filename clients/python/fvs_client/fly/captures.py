"""Photographs as a camera reports them: each once, and those whose report was lost, too."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

_MOST_MISSING = 100
"""Maximum number of reports that are requested at once."""


@dataclass(frozen=True)
class Capture:
    """A photograph that the camera has reported; ``file`` is its name, empty when the camera reports none."""

    number: int
    succeeded: bool
    file: str
    place: tuple[float, float] | None = None
    """Latitude and longitude in degrees; None when the camera does not know."""
    altitude_m: float = 0.0
    height_m: float = 0.0


class Captures:
    """Collects reports. Cameras number photographs from 0: where numbers are left out, ``ask`` gets those."""

    def __init__(self, ask: Callable[[int], None]) -> None:
        self._ask = ask
        self._new: list[Capture] = []
        self._seen: set[tuple[int, int]] = set()
        self._next: int | None = None
        """The number of the next photograph; None as long as it is not known."""
        self._since_ms = 0
        """The camera's clock at the beginning: it may report earlier photographs, but they are not ours."""
        self._asked: set[int] = set()

    def take(self) -> list[Capture]:
        """The photographs reported since the last call."""
        found, self._new = self._new, []
        return found

    def add(self, message: Any) -> None:
        """Record a ``CAMERA_IMAGE_CAPTURED``; duplicates are ignored."""
        number = message.image_index
        key = (number, message.time_boot_ms)
        if key in self._seen:
            return
        self._seen.add(key)
        if number in self._asked and message.time_boot_ms < self._since_ms:
            return
        url = message.file_url
        text = url.decode(errors="replace") if isinstance(url, bytes) else url
        located = message.lat != 0 or message.lon != 0
        place = (message.lat / 1e7, message.lon / 1e7) if located else None
        heights = (message.alt / 1e3, message.relative_alt / 1e3)
        name = text.rstrip("\0").rpartition("/")[2]
        self._new.append(Capture(number, message.capture_result == 1, name, place, *heights))
        if self._next is None or number >= self._next:
            self._ask_before(number)
            self._next = number + 1

    def are(self, count: int, time_ms: int) -> None:
        """Record the number of all photographs and the time of a ``CAMERA_CAPTURE_STATUS``."""
        if self._next is None or count < self._next:  # the first time, or the camera was switched on again
            self._next, self._since_ms = count, time_ms
            self._asked.clear()
        else:
            self._ask_before(count)

    def _ask_before(self, end: int) -> None:
        """Request the missing reports before number ``end``."""
        if self._next is None:
            return
        for number in range(self._next, min(end, self._next + _MOST_MISSING)):
            self._asked.add(number)
            self._ask(number)
