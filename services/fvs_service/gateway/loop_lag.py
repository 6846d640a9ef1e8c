"""The lag of the event loop: the delay of tasks that are due."""

import asyncio
import time

from prometheus_client import Histogram

_EVERY_S = 0.02
_IDLE_EVERY_S = 5.0
_BUSY_FOR_S = 1.0


class LoopLag:
    """Observes the lag fifty times a second while requests are handled, else every five seconds."""

    def __init__(self, lag: Histogram) -> None:
        self._lag = lag
        self._handled = asyncio.Event()
        self._idle_from = 0.0

    def handling(self) -> None:
        """Observe often for the next second, because a request is being handled. Called in the loop."""
        self._idle_from = time.monotonic() + _BUSY_FOR_S
        self._handled.set()

    async def watch(self) -> None:
        """Observe until cancelled."""
        while True:
            due: float | None
            if time.monotonic() < self._idle_from:
                due = time.monotonic() + _EVERY_S
                await asyncio.sleep(_EVERY_S)
            elif (due := await self._idle()) is None:
                continue
            self._lag.observe(max(0.0, time.monotonic() - due))

    async def _idle(self) -> float | None:
        """Wait up to five seconds for a request; returns when they were due to end, None after a request."""
        self._handled.clear()
        due = time.monotonic() + _IDLE_EVERY_S
        try:
            await asyncio.wait_for(self._handled.wait(), _IDLE_EVERY_S)
        except TimeoutError:
            return due
        return None
