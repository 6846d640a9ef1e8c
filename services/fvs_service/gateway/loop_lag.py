"""The lag of the event loop: how late it runs what is due."""

import asyncio

from prometheus_client import Histogram

_EVERY_S = 0.02


async def watch_loop(lag: Histogram) -> None:
    """Observe the lag fifty times a second, until cancelled."""
    loop = asyncio.get_running_loop()
    while True:
        due = loop.time() + _EVERY_S
        await asyncio.sleep(_EVERY_S)
        lag.observe(max(0.0, loop.time() - due))
