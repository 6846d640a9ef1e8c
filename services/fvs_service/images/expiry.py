"""Expiry of uploads that nobody resumes."""

import asyncio
from collections.abc import Callable

import anyio.to_thread
import structlog

_log = structlog.get_logger()


async def prune_regularly(every_s: float, *prunes: Callable[[], None]) -> None:
    """Call all of ``prunes``, which delete what has expired, regularly until cancelled."""
    while True:
        for prune in prunes:
            try:
                await anyio.to_thread.run_sync(prune)
            except OSError as error:
                _log.warning("uploads cannot be deleted", reason=str(error))
        await asyncio.sleep(every_s)
