"""Locks of uploads: one request at a time writes to an upload.

A device whose link broke may come back while the service still waits for the rest of its last request. That
request gives way once its bytes have stopped arriving.
"""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field

from fvs_service.errors import LockedError
from fvs_service.images.upload_places import UploadPlace

_STALLED_S = 2.0
"""Time without a byte after which a request gives way."""
_LOOK_AGAIN_S = 0.1


@dataclass(eq=False)
class _Lock:
    place: UploadPlace | None
    released: asyncio.Event = field(default_factory=asyncio.Event)


class UploadLocks:
    """Gives each upload to one request at a time; all calls are made on one event loop."""

    def __init__(self) -> None:
        self._locks: dict[str, _Lock] = {}

    @contextlib.asynccontextmanager
    async def locked(
        self,
        upload_id: str,
        place: UploadPlace | None = None,
        *,
        waits: bool = False,
        by_force: bool = False,
    ) -> AsyncIterator[None]:
        """Hold the lock of an upload; a request that receives bytes of it gives its ``place``.

        Such a request raises ``LockedError`` while another one receives bytes, unless it ``waits``. All other
        requests wait for that one, or end it (``by_force``).
        """
        while (other := self._locks.get(upload_id)) is not None:
            if other.place is not None and other.place.arriving:
                if by_force or other.place.arrival.idle_s >= _STALLED_S:
                    other.place.take(LockedError("Another request has taken this upload over."))
                elif place is not None and not waits:
                    raise LockedError("Another request is sending this upload.", retry_after_s=1)
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(other.released.wait(), _LOOK_AGAIN_S)
        lock = self._locks[upload_id] = _Lock(place)
        try:
            yield
        finally:
            del self._locks[upload_id]
            lock.released.set()
