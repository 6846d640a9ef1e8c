"""The deliveries of webhooks: a loop in every gateway, which share the work through the database.

The events wait in the database, in order; a webhook has a cursor into them. So nothing is lost while a
receiver or the service is down, as long as the retention keeps the events, and a restart goes on where the
last delivery was recorded. A gateway that dies after a delivery repeats it, with the same ``webhook-id``.
"""

import asyncio
import contextlib
import time
from collections.abc import Callable
from typing import TypeVar

import anyio.to_thread
import structlog
from sqlalchemy.exc import SQLAlchemyError
from sqlalchemy.orm import Session

from fvs_schema.events import Event, EventKind
from fvs_service.errors import ServiceError
from fvs_service.events.repository import events_after
from fvs_service.storage.database import Database
from fvs_service.uninterrupted import to_its_end
from fvs_service.webhooks import repository
from fvs_service.webhooks.repository import Claim
from fvs_service.webhooks.sending import DeliveryError, Sender

_AT_ONCE = 32
_POLL_S = 5.0
"""Interval at which due deliveries are looked for."""
_LEASE_S = 60
_RENEW_S = 30
"""After this time a gateway gives a webhook with more events back, to claim it again."""
_BATCH = 64
_SPACING_S = 0.05
_AFTER_ERROR_S = 5.0

_Result = TypeVar("_Result")

_log = structlog.get_logger()


class Deliveries:
    """Delivers events when notified, and looks for due deliveries every ``_POLL_S``."""

    def __init__(self, database: Database, sender: Sender) -> None:
        self._database, self._sender = database, sender
        self._running: dict[str, asyncio.Task[None]] = {}
        self._notified = asyncio.Event()
        self._loop = asyncio.get_running_loop()

    def notify(self) -> None:
        """There may be something to deliver. Callable from any thread."""
        self._loop.call_soon_threadsafe(self._notified.set)

    async def run(self) -> None:
        """Deliver until cancelled."""
        try:
            while True:
                try:
                    await self._start_due()
                except (SQLAlchemyError, ServiceError) as error:
                    _log.warning("no webhooks can be read", reason=type(error).__name__)
                    await asyncio.sleep(_AFTER_ERROR_S)
                await asyncio.sleep(_SPACING_S)
                with contextlib.suppress(TimeoutError):
                    async with asyncio.timeout(_POLL_S):
                        await self._notified.wait()
                self._notified.clear()
        finally:
            for task in self._running.values():
                task.cancel()
            await asyncio.gather(*self._running.values(), return_exceptions=True)

    async def _start_due(self) -> None:
        room = _AT_ONCE - len(self._running)
        if room <= 0:
            return
        running = tuple(self._running)
        for webhook_id in await self._read(lambda session: repository.due_webhooks(session, running, room)):
            task = asyncio.create_task(self._deliver(webhook_id))
            self._running[webhook_id] = task
            task.add_done_callback(lambda _, ended=webhook_id: self._ended(ended))  # type: ignore[misc]

    def _ended(self, webhook_id: str) -> None:
        del self._running[webhook_id]
        self._notified.set()

    async def _deliver(self, webhook_id: str) -> None:
        try:
            claimed = await self._write(
                lambda session: repository.claim(session, webhook_id, 1_000 * _LEASE_S)
            )
            if claimed is not None:
                try:
                    await self._deliver_all(claimed)
                except asyncio.CancelledError:  # the gateway stops: another one goes on at once
                    await self._write(lambda session: repository.release(session, claimed))
                    raise
        except (SQLAlchemyError, ServiceError) as error:
            _log.warning("a webhook waits", webhook=webhook_id, reason=type(error).__name__)

    async def _deliver_all(self, claimed: Claim) -> None:
        """Deliver what waits, in order, until a failure; then give the webhook back."""
        until, after = time.monotonic() + _RENEW_S, claimed.delivered
        while time.monotonic() < until:
            number = after
            events = await self._read(
                lambda session, at=number: events_after(session, claimed.scene_id, at, _BATCH)
            )
            for event in events:
                sent = event.kind.value in claimed.kinds
                if sent:
                    try:
                        await self._send(claimed, event)
                    except DeliveryError as error:
                        await self._failed(claimed, str(error))
                        return
                if event.kind is EventKind.SCENE_DELETED:
                    await self._write(lambda session: repository.remove(session, claimed.id))
                    return
                after = event.number
                if (sent or event is events[-1]) and not await self._dealt_with(claimed, after, sent=sent):
                    return
                if time.monotonic() >= until:
                    break
            if not events:
                break
        await self._write(lambda session: repository.release(session, claimed))

    async def _send(self, claimed: Claim, event: Event) -> None:
        body = event.model_dump_json().encode()
        # A gap has the number of an event that may have been delivered before.
        gap = "_gap" if event.kind is EventKind.EVENTS_DELETED else ""
        message_id = f"{claimed.id}_{event.number}{gap}"
        await self._sender.send(claimed.url, claimed.secret, message_id, int(time.time()), body)

    async def _dealt_with(self, claimed: Claim, number: int, *, sent: bool) -> bool:
        return await self._write(
            lambda session: repository.record_delivery(session, claimed, number, sent=sent)
        )

    async def _failed(self, claimed: Claim, error: str) -> None:
        _log.info("webhook failed", webhook=claimed.id, scene_id=claimed.scene_id, reason=error)
        await self._write(lambda session: repository.record_failure(session, claimed, error))

    async def _read(self, query: Callable[..., _Result]) -> _Result:
        def run() -> _Result:
            with self._database.reading() as session:
                return query(session)

        return await to_its_end(anyio.to_thread.run_sync(run))

    async def _write(self, change: Callable[[Session], _Result]) -> _Result:
        def run() -> _Result:
            with self._database.writing(durable=False) as session:
                return change(session)

        return await to_its_end(anyio.to_thread.run_sync(run))
