"""Limit sending to a number of bytes per second."""

import time
from collections.abc import Callable

_BURST_S = 0.25
_BLOCK_BYTES = 4 << 10
_SMALLEST_BLOCK_BYTES = 1 << 10


class Pace:
    """A bucket that fills at ``bytes_s`` and may be empty for a while; None sends as fast as the link is."""

    def __init__(
        self,
        bytes_s: float | None,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._bytes_s = bytes_s
        self._clock, self._sleep = clock, sleep
        self._free_at = clock()

    @property
    def block_bytes(self) -> int:
        """Size of a block, which takes a quarter of a second."""
        if self._bytes_s is None:
            return _BLOCK_BYTES
        return max(_SMALLEST_BLOCK_BYTES, min(_BLOCK_BYTES, int(self._bytes_s * _BURST_S)))

    def spend(self, size_bytes: int) -> None:
        """Wait until so many bytes may be sent."""
        if self._bytes_s is None:
            return
        now = self._clock()
        self._free_at = max(self._free_at, now - _BURST_S) + size_bytes / self._bytes_s
        if self._free_at > now:
            self._sleep(self._free_at - now)
