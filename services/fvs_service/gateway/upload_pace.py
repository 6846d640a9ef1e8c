"""The minimum speed of uploads, and of clients that read a response."""

import asyncio
import time
from collections.abc import Awaitable, Callable
from typing import TypeVar

from fvs_service.errors import SlowRequestError
from fvs_service.settings import Settings

PartT = TypeVar("PartT")
READ_WITHIN_S = 120.0
"""Time after which the connection of a client that does not read its response is closed."""


class UploadPace:
    """Remaining patience with a slow upload.

    It begins with the grace period. Waiting uses it up, each byte restores the time that a body of the least
    allowed speed takes for it, and it never exceeds the grace period: a fast start does not pay for a slow
    rest. Only the client's time counts, not that in which no more bytes are asked for.
    """

    def __init__(self, settings: Settings) -> None:
        self._idle_s, self._grace_s = settings.upload_idle_s, settings.upload_grace_s
        self._bytes_per_s = settings.upload_bytes_per_s
        self._left_s = self._grace_s
        self.received_bytes = 0
        self._last_byte_at = time.monotonic()

    @property
    def idle_s(self) -> float:
        """Time since the last byte."""
        return time.monotonic() - self._last_byte_at

    async def wait(self, receive: Callable[[], Awaitable[PartT]], size: Callable[[PartT], int]) -> PartT:
        """The next part of the body, which has ``size`` bytes; raises ``SlowRequestError``."""
        started = time.monotonic()
        try:
            async with asyncio.timeout(min(self._idle_s, self._left_s)):
                part = await receive()
        except TimeoutError as error:
            raise self._error() from error
        waited_s = time.monotonic() - started
        if size(part):
            self.received_bytes += size(part)
            self._last_byte_at = time.monotonic()
        restored_s = size(part) / self._bytes_per_s
        self._left_s = min(self._grace_s, self._left_s - waited_s + restored_s)
        if self._left_s <= 0:
            raise self._error()
        return part

    def _error(self) -> SlowRequestError:
        if self._left_s > self._idle_s:
            return SlowRequestError(
                f"No byte of the body arrived for {self._idle_s:g} s.", hint="Send the request again."
            )
        return SlowRequestError(
            f"The body arrived at less than {self._bytes_per_s:g} bytes per second for {self._grace_s:g} s.",
            hint="Send it again over a better connection. The operator can raise FVS_UPLOAD_GRACE_S.",
        )
