"""Streams of events: one query of the database serves all streams of this process.

It runs when a notification announces new events, and at intervals without one.
"""

import asyncio
import contextlib
from collections.abc import AsyncGenerator, Callable
from typing import TypeVar

import anyio.to_thread
import structlog
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from fvs_schema.events import Event, EventKind
from fvs_service.auth import Keys
from fvs_service.concurrency import ConcurrencyLimit
from fvs_service.errors import ServiceError
from fvs_service.events.repository import events_after, last_number
from fvs_service.principal import Principal, Scope
from fvs_service.storage.database import Database

_BATCH = 256
_POLL_S = 5.0
"""Interval between two queries without a notification, because one can get lost."""
_SPACING_S = 0.02
"""Minimum time between two queries, so that many notifications in a short time cause one query."""
_AFTER_ERROR_S = 1.0
_Result = TypeVar("_Result")

_log = structlog.get_logger()


class EventFeed:
    """Streams committed events, also those of other processes.

    ``require`` raises unless the principal may read the scene (events must not import scenes).
    """

    def __init__(
        self,
        database: Database,
        keys: Keys,
        require: Callable[[Principal, str], object],
        *,
        heartbeat_s: float,
        streams_per_tenant: int,
    ) -> None:
        self._database = database
        self._keys = keys
        self._require = require
        self._heartbeat_s = heartbeat_s
        self.stream_limit = ConcurrencyLimit("event streams", streams_per_tenant)
        self._newest = 0
        self._followers = 0
        self._closed = False
        self._changed = asyncio.Condition()
        self._followed = asyncio.Event()
        self._notified = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    def check(self, principal: Principal, scene_id: str) -> None:
        """Raise unless the principal may read the scene."""
        principal.require(Scope.READ, scene_id)
        self._require(principal, scene_id)

    async def newest(self) -> int:
        """The number of the newest event of all scenes: a stream after it has only new events."""
        return await self._read(last_number)

    def notify(self) -> None:
        """Wake the feed, if a stream waits: there may be new events. Callable from any thread."""
        if self._followers:  # a new stream reads the database before it waits
            self._loop.call_soon_threadsafe(self._notified.set)

    async def watch(self) -> None:
        """While there are streams, look for events when notified and every ``_POLL_S``, until cancelled."""
        while True:
            await self._followed.wait()
            with contextlib.suppress(TimeoutError):
                async with asyncio.timeout(_POLL_S):
                    await self._notified.wait()
            self._notified.clear()
            try:
                newest = await self._read(last_number)
            except (SQLAlchemyError, ServiceError) as error:
                _log.warning("no events can be read", reason=type(error).__name__)
                await asyncio.sleep(_AFTER_ERROR_S)
                continue
            if newest > self._newest:
                async with self._changed:
                    self._newest = newest
                    self._changed.notify_all()
            await asyncio.sleep(_SPACING_S)

    async def close(self) -> None:
        """End all streams."""
        async with self._changed:
            self._closed = True
            self._changed.notify_all()

    async def follow(
        self, principal: Principal, scene_id: str, after: int
    ) -> AsyncGenerator[Event | None, None]:
        """The events of a scene after number ``after``; None is a heartbeat without an event.

        Ends only after the event that the scene was deleted, or when the feed is closed. Raises
        ``UnauthenticatedError`` once the principal's key is no longer valid.
        """

        def next_events(session: Session) -> tuple[Event, ...]:
            self._keys.require_valid(session, principal)
            return events_after(session, scene_id, after, _BATCH)

        self._followers += 1
        self._followed.set()
        try:
            while not self._closed:
                seen = self._newest
                events = await self._read(next_events)
                for event in events:
                    after = event.number
                    yield event
                    if event.kind is EventKind.SCENE_DELETED:
                        return
                if not events and not await self._wait(seen) and not self._closed:
                    yield None
        finally:
            self._followers -= 1
            if self._followers == 0:
                self._followed.clear()

    async def _wait(self, seen: int) -> bool:
        """Wait until there is an event newer than ``seen``; False when a heartbeat is due first."""
        with contextlib.suppress(TimeoutError):
            async with asyncio.timeout(self._heartbeat_s), self._changed:
                await self._changed.wait_for(lambda: self._newest > seen or self._closed)
                return True
        return False

    async def _read(self, query: Callable[..., _Result]) -> _Result:
        def run() -> _Result:
            with self._database.reading() as session:
                return query(session)

        return await anyio.to_thread.run_sync(run)
