"""Sizes of the pieces of a photograph that go into one request."""

import time
from collections.abc import Callable

_FIRST_BYTES = 256 << 10
_SMALLEST_BYTES = 64 << 10
_LARGEST_BYTES = 8 << 20
_BUFFERS_BYTES = 48 << 10
"""Minimum size of a piece: a break loses that much anyway."""
_TAKES_S = 20.0
_FIRST_GROWTH = 2.0
_CAREFUL_GROWTH = 1.05
"""Once a piece was lost: where breaks decide their size few are then lost, and with 2 every second."""


class Pieces:
    """Sizes of pieces that take about 20 s on the link as it is.

    What has arrived of a piece is kept when the connection breaks, except by a proxy that passes on whole
    requests only. Behind one, and where a proxy limits the size of bodies, pieces become smaller.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._size = _FIRST_BYTES
        self._growth = _FIRST_GROWTH
        self._begun: tuple[int, int, float] | None = None
        self._sent = 0

    def begin(self, number: int, offset_bytes: int, left_bytes: int) -> int:
        """Begin a piece of photograph ``number``; its size in bytes."""
        self._begun = (number, offset_bytes, self._clock())
        self._sent = 0
        return min(self._size, left_bytes)

    def sent(self, size_bytes: int) -> None:
        """Count bytes of the current piece as sent."""
        self._sent += size_bytes

    def stopped(self) -> None:
        """The answer came before the end of the piece, which therefore says nothing."""
        self._begun = None

    def arrived(self, number: int, offset_bytes: int) -> None:
        """``offset_bytes`` of a photograph have arrived: adapt the size of the next piece to the last one."""
        begun, self._begun = self._begun, None
        if begun is None or begun[0] != number or self._sent == 0:
            return
        arrived = offset_bytes - begun[1]
        if arrived < self._sent // 2 and self._sent - arrived > _BUFFERS_BYTES:
            self._size = max(_SMALLEST_BYTES, self._size // 2)
            self._growth = _CAREFUL_GROWTH
        elif arrived == self._sent:
            elapsed_s = max(self._clock() - begun[2], 1e-3)
            fits = int(arrived / elapsed_s * _TAKES_S)
            self._size = max(_SMALLEST_BYTES, min(_LARGEST_BYTES, fits, int(self._growth * self._size)))
