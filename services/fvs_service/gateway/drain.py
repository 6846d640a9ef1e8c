"""Draining: a gateway that stops accepts no more requests, and gives those in progress time to end."""

import asyncio
import contextlib
from collections.abc import Iterator
from contextlib import contextmanager


class Drain:
    """Counts the requests in progress over REST and gRPC. Used on the event loop only."""

    def __init__(self) -> None:
        self._open = 0
        self._begun, self._none_open = asyncio.Event(), asyncio.Event()

    @property
    def begun(self) -> bool:
        """Whether the gateway stops: it is not ready, and refuses new requests."""
        return self._begun.is_set()

    def begin(self) -> None:
        """Refuse new requests."""
        self._begun.set()

    async def wait(self, within_s: float) -> bool:
        """Wait until the gateway stops, but not longer than ``within_s``; returns whether it does."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                await self._begun.wait()
        return self.begun

    @contextmanager
    def request(self) -> Iterator[None]:
        """A request in progress."""
        self._open += 1
        try:
            yield
        finally:
            self._open -= 1
            if self._open == 0:
                self._none_open.set()

    async def ended(self, within_s: float) -> None:
        """Wait until no request is in progress, but not longer than ``within_s``."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(within_s):
                while self._open:
                    self._none_open.clear()
                    await self._none_open.wait()
