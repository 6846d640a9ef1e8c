"""Upload places: they limit a tenant's concurrent uploads, and decide which one gives way to a new one.

An upload that has held its place for a grace period gives way to one of a key that holds fewer places; after
a longer time it gives way to any. The slowest goes first.
"""

import asyncio
import math
import time
from collections import Counter
from collections.abc import AsyncIterator, Iterator, Sequence
from contextlib import asynccontextmanager, contextmanager
from dataclasses import dataclass, field
from typing import Protocol

from fvs_service.errors import LimitExceededError, ServiceError, SlowRequestError
from fvs_service.principal import Principal


class Arrival(Protocol):
    """A body that arrives."""

    @property
    def received_bytes(self) -> int:
        """Number of bytes received."""

    @property
    def idle_s(self) -> float:
        """Time since the last byte."""


@dataclass(eq=False)
class UploadPlace:
    """The place of one upload; it can be taken away while the body arrives."""

    principal: Principal
    arrival: Arrival
    expected_bytes: int | None
    since: float = field(default_factory=time.monotonic)
    taken: ServiceError | None = None
    _timer: asyncio.Timeout | None = None

    @asynccontextmanager
    async def receiving(self) -> AsyncIterator[None]:
        """Receive in this block; the error of ``take`` is raised in it."""
        try:
            if self.taken:
                raise TimeoutError
            async with asyncio.timeout(None) as self._timer:
                yield
        except TimeoutError:
            if not self.taken:
                raise
            raise self.taken from None
        finally:
            self._timer = None

    def take(self, reason: ServiceError) -> None:
        """End the upload, which then fails with ``reason``; no effect when it ends already."""
        assert self._timer is not None
        if self.taken:
            return
        self.taken = reason
        self._timer.reschedule(asyncio.get_running_loop().time())

    @property
    def arriving(self) -> bool:
        """Whether the body is being received, not stored."""
        return self._timer is not None

    @property
    def held_s(self) -> float:
        """The age of the upload."""
        return time.monotonic() - self.since

    @property
    def bytes_per_s(self) -> float:
        """The average speed of the body."""
        return self.arrival.received_bytes / max(self.held_s, 1e-3)

    @property
    def left_s(self) -> float:
        """Time until the upload ends at its average speed; infinite when its size is unknown."""
        if not self.arriving:
            return 0.0
        if self.expected_bytes is None or not self.arrival.received_bytes:
            return math.inf
        return (self.expected_bytes - self.arrival.received_bytes) / self.bytes_per_s


class UploadPlaces:
    """Gives each tenant ``limit`` places in this process; all calls are made on one event loop.

    An upload keeps its place for ``grace_s`` against keys that hold fewer places, and for ``hold_s`` against
    all.
    """

    def __init__(self, limit: int, *, grace_s: float, hold_s: float) -> None:
        self._limit, self._grace_s, self._hold_s = limit, grace_s, hold_s
        self._places: set[UploadPlace] = set()

    @contextmanager
    def place(
        self, principal: Principal, arrival: Arrival, expected_bytes: int | None
    ) -> Iterator[UploadPlace]:
        """Hold an upload place for the duration of the block; raises ``LimitExceededError`` without one.

        ``expected_bytes`` is the declared size of the body, None without one.
        """
        theirs = [place for place in self._places if place.principal.tenant_id == principal.tenant_id]
        if len(theirs) >= self._limit:
            self._take_one(theirs, principal)
        place = UploadPlace(principal, arrival, expected_bytes)
        self._places.add(place)
        try:
            yield place
        finally:
            self._places.discard(place)

    def _take_one(self, theirs: Sequence[UploadPlace], principal: Principal) -> None:
        kept_s = self._kept_s(theirs, principal)
        givable = [place for place in theirs if place.arriving and kept_s[place] <= 0]
        if not givable:
            wait_s = min(min(place.left_s, max(kept_s[place], 0.0)) for place in theirs)
            raise LimitExceededError(
                f"{self._limit} uploads are open, and no more are allowed at once.",
                retry_after_s=max(1, math.ceil(wait_s)),
            )
        slowest = min(givable, key=lambda place: place.bytes_per_s)
        self._places.discard(slowest)
        slowest.take(
            SlowRequestError(
                "All upload places are taken, and a new upload has replaced this one, which arrived at "
                f"{slowest.bytes_per_s:.0f} bytes per second.",
                hint="Send it again over a better connection. Over gRPC, and from /v1/uploads, it resumes "
                "where it stopped.",
            )
        )

    def _kept_s(self, theirs: Sequence[UploadPlace], principal: Principal) -> dict[UploadPlace, float]:
        """Time for which each place cannot yet be taken by the principal."""
        held = Counter(place.principal.key_id for place in theirs)
        fewer = held[principal.key_id] + 1
        return {
            place: (self._grace_s if held[place.principal.key_id] > fewer else self._hold_s) - place.held_s
            for place in theirs
        }
