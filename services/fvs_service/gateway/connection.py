"""HTTP connections with a time limit for the headers of a request.

uvicorn waits without limit for the rest of a request's headers. Each connection takes a file descriptor, of
which a process has few, and no key is checked before the headers have arrived.
"""

import asyncio

from uvicorn.protocols.http.h11_impl import H11Protocol


def http_protocol(head_within_s: float) -> type[H11Protocol]:
    """A uvicorn protocol that closes connections whose request line and headers do not arrive in time."""

    class LimitedProtocol(H11Protocol):
        _deadline: asyncio.TimerHandle | None = None

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            self._watch()

        def data_received(self, data: bytes) -> None:
            super().data_received(data)
            self._watch()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop()
            super().connection_lost(exc)

        def _watch(self) -> None:
            if self.cycle is not None and not self.cycle.response_complete:
                self._stop()  # the headers have arrived; the body has a limit of its own
            elif self._deadline is None:
                self._deadline = self.loop.call_later(head_within_s, self.transport.close)

        def _stop(self) -> None:
            if self._deadline is not None:
                self._deadline.cancel()
                self._deadline = None

    return LimitedProtocol
