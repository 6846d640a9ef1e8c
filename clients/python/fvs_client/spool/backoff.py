"""Pauses after failures."""

import random
from collections.abc import Callable


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
