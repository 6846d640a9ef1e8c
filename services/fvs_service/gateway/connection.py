"""HTTP connections with limits on what a client may send before it is known, and on how slowly it may read.

uvicorn waits without limit for the rest of a request's headers and for a client that does not read its
response, and takes heads of any size. Each connection takes a file descriptor, of which a process has few.
The parser is llhttp: h11, in Python, holds the event loop for a second when a body comes in chunks of a byte.
"""

import asyncio

from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol

MAX_HEAD_BYTES = 32_768
"""The request line and all headers."""
_MAX_HEADERS = 100
_MAX_PIPELINED = 8
_SMALL_PIECE_BYTES, _FREE_PIECES = 64, 256
"""A body may have this many pieces of any size; all of its pieces must then be larger on average."""
_READ_BYTES = 262_144


class _LimitError(Exception):
    """The client has exceeded a limit; the parser turns it into 400, and the connection is closed."""


def http_protocol(head_within_s: float, *, read_within_s: float) -> type[HttpToolsProtocol]:
    """A uvicorn protocol that closes connections whose request head does not arrive in time.

    It also cuts connections whose client has read so little in ``read_within_s`` that the response's buffer
    stays full.
    """

    class LimitedProtocol(HttpToolsProtocol):
        _head_deadline: asyncio.TimerHandle | None = None
        _read_deadline: asyncio.TimerHandle | None = None
        _in_head, _head_began = True, False
        _unfinished_bytes = _head_bytes = _headers_seen = _pieces = _body_bytes = 0

        def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
            super().connection_made(transport)
            # One call handles what one read returns: a small one leaves the loop to others in between.
            transport.max_size = _READ_BYTES  # type: ignore[attr-defined]
            self._watch()

        def data_received(self, data: bytes) -> None:
            self._head_began = False
            super().data_received(data)
            # The read in which a head begins may hold much of the body before it.
            counted = self._in_head and not self._head_began
            self._unfinished_bytes = self._unfinished_bytes + len(data) if counted else 0
            if self._unfinished_bytes > MAX_HEAD_BYTES:  # of a header that has not ended
                self.transport.close()
            self._watch()

        def connection_lost(self, exc: Exception | None) -> None:
            self._stop_head_deadline()
            self._stop_read_deadline()
            super().connection_lost(exc)

        def on_message_begin(self) -> None:
            if len(self.pipeline) >= _MAX_PIPELINED:
                raise _LimitError
            super().on_message_begin()
            self._in_head = self._head_began = True
            self._head_bytes = self._headers_seen = self._pieces = self._body_bytes = 0

        def on_url(self, url: bytes) -> None:
            super().on_url(url)
            self._count(len(url))

        def on_header(self, name: bytes, value: bytes) -> None:
            self._headers_seen += 1
            self._count(len(name) + len(value))
            if self._in_head:  # others are trailers of a chunked body
                super().on_header(name, value)

        def on_headers_complete(self) -> None:
            self._in_head = False
            super().on_headers_complete()

        def on_body(self, body: bytes) -> None:
            self._pieces += 1
            self._body_bytes += len(body)
            if self._pieces > _FREE_PIECES and self._body_bytes < self._pieces * _SMALL_PIECE_BYTES:
                raise _LimitError
            super().on_body(body)

        def pause_writing(self) -> None:
            super().pause_writing()
            if self._read_deadline is None:
                self._read_deadline = self.loop.call_later(read_within_s, self.transport.abort)

        def resume_writing(self) -> None:
            self._stop_read_deadline()
            super().resume_writing()

        def _count(self, size: int) -> None:
            self._head_bytes += size
            if self._headers_seen > _MAX_HEADERS or self._head_bytes > MAX_HEAD_BYTES:
                raise _LimitError

        def _watch(self) -> None:
            if self.cycle is not None and not self.cycle.response_complete:
                self._stop_head_deadline()  # the body has limits of its own
            elif self._head_deadline is None:
                self._head_deadline = self.loop.call_later(head_within_s, self.transport.close)

        def _stop_head_deadline(self) -> None:
            if self._head_deadline is not None:
                self._head_deadline.cancel()
                self._head_deadline = None

        def _stop_read_deadline(self) -> None:
            if self._read_deadline is not None:
                self._read_deadline.cancel()
                self._read_deadline = None

    return LimitedProtocol
