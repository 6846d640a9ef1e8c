"""HTTP connections with limits on what a client may send before it is known, and on how slowly it may read.

uvicorn waits without limit for the rest of a request's headers and for a client that does not read its
response, and takes heads of any size. Each connection takes a file descriptor, of which a process has few.
The parser is llhttp: h11, in Python, holds the event loop for a second when a body comes in chunks of a byte.
"""

import asyncio
from typing import Any

from uvicorn._types import ASGI3Application
from uvicorn.protocols.http.httptools_impl import HttpToolsProtocol, RequestResponseCycle

from fvs_service.errors import MalformedRequestError
from fvs_service.gateway.request_id import HEADER
from fvs_service.gateway.rest.problems import MEDIA_TYPE, problem_of
from fvs_service.gateway.upload_pace import READ_WITHIN_S
from fvs_service.ids import new_id

MAX_HEAD_BYTES = 32_768
"""Maximum size of the request line and all headers."""
_MAX_HEADERS = 100
_MAX_PIPELINED = 8
_SMALL_PIECE_BYTES, _FREE_PIECES = 64, 256
"""A body may have this many pieces of any size; all of its pieces must then be larger on average."""
_READ_BYTES = 262_144
_FIRST_READ_BYTES = 16_384
"""Bytes read at once before the application asks for the body."""
_DISCARDED_BYTES = 65_536
"""If more bytes of a body are unread after the response, the connection closes."""
_LEAVE_S = 1.0
"""Time for which such a connection stays open. Closing it with unread bytes resets it, and many clients
then lose the response."""


_HEAD = f"The head of the request has more than {MAX_HEAD_BYTES} bytes or {_MAX_HEADERS} headers."
_PIPELINE = f"More than {_MAX_PIPELINED} requests were sent before the first was answered."
_CHUNKS = "The body comes in too many small chunks."


class _LimitError(Exception):
    """The client has exceeded a limit; the parser turns it into 400, and the connection is closed."""


def _refusal(message: str) -> bytes:
    """Response to data that is not a request or exceeds a limit before a request is parsed."""
    request_id = new_id("req")
    error = MalformedRequestError(message, hint="Send an HTTP/1.1 request within these limits.")
    document = problem_of(error, request_id).model_dump_json().encode()
    head = (
        f"HTTP/1.1 {error.status} Bad Request\r\ncontent-type: {MEDIA_TYPE}\r\n{HEADER}: {request_id}\r\n"
        f"content-length: {len(document)}\r\nconnection: close\r\n\r\n"
    )
    return head.encode() + document


class _LimitedProtocol(HttpToolsProtocol):
    """Closes connections whose request head does not arrive within ``head_within_s``.

    It also cuts connections whose client has read so little in ``read_within_s`` that the response's buffer
    stays full. A body that is not needed for the response is not read.
    """

    head_within_s: float
    read_within_s = READ_WITHIN_S
    _head_deadline: asyncio.TimerHandle | None = None
    _read_deadline: asyncio.TimerHandle | None = None
    _in_head, _head_began = True, False
    _exceeded = ""
    _unfinished_bytes = _head_bytes = _headers_seen = _pieces = _body_bytes = 0
    _declared_bytes: int | None = None
    _leaves_body = _body_wanted = False

    def connection_made(self, transport: asyncio.Transport) -> None:  # type: ignore[override]
        super().connection_made(transport)
        self._read_at_most(_FIRST_READ_BYTES)
        self._watch()

    def data_received(self, data: bytes) -> None:
        self._head_began = False
        super().data_received(data)
        if self._waits_for_app():
            self.flow.pause_reading()
        # The read in which a head begins may hold much of the body before it.
        counted = self._in_head and not self._head_began
        self._unfinished_bytes = self._unfinished_bytes + len(data) if counted else 0
        if self._unfinished_bytes > MAX_HEAD_BYTES:  # of a header that has not ended
            self._exceeded = _HEAD
            self.send_400_response("")
        self._watch()

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_head_deadline()
        self._stop_read_deadline()
        super().connection_lost(exc)

    def on_message_begin(self) -> None:
        if len(self.pipeline) >= _MAX_PIPELINED:
            self._refuse(_PIPELINE)
        super().on_message_begin()
        self._in_head = self._head_began = True
        self._head_bytes = self._headers_seen = self._pieces = self._body_bytes = 0
        self._declared_bytes, self._body_wanted = None, False
        self._read_at_most(_FIRST_READ_BYTES)

    def on_url(self, url: bytes) -> None:
        super().on_url(url)
        self._count(len(url))

    def on_header(self, name: bytes, value: bytes) -> None:
        self._headers_seen += 1
        self._count(len(name) + len(value))
        if self._in_head:  # others are trailers of a chunked body
            super().on_header(name, value)
            if name.lower() == b"content-length":
                self._declared_bytes = int(value)  # the parser has checked it

    def on_headers_complete(self) -> None:
        self._in_head = False
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        self._pieces += 1
        self._body_bytes += len(body)
        if self._pieces > _FREE_PIECES and self._body_bytes < self._pieces * _SMALL_PIECE_BYTES:
            self._refuse(_CHUNKS)
        super().on_body(body)

    def on_response_complete(self) -> None:
        super().on_response_complete()
        if self._leaves_body and not self.transport.is_closing():
            self._leave()

    def pause_writing(self) -> None:
        super().pause_writing()
        if self._read_deadline is None:
            self._read_deadline = self.loop.call_later(self.read_within_s, self.transport.abort)

    def resume_writing(self) -> None:
        self._stop_read_deadline()
        super().resume_writing()

    def _count(self, size: int) -> None:
        self._head_bytes += size
        if self._headers_seen > _MAX_HEADERS or self._head_bytes > MAX_HEAD_BYTES:
            self._refuse(_HEAD)

    def _refuse(self, exceeded: str) -> None:
        self._exceeded = exceeded
        raise _LimitError

    def send_400_response(self, msg: str) -> None:  # noqa: ARG002 - it is always the same
        if self.transport.is_closing():
            return
        answering = self.cycle is not None and self.cycle.response_started
        if not answering or self.cycle.response_complete:  # else it would go into that response
            self.transport.write(_refusal(self._exceeded or "The data is not an HTTP/1.1 request."))
        self.transport.close()

    def _start_asgi_task(self, cycle: RequestResponseCycle, app: ASGI3Application) -> None:
        async def leaving_body(scope: Any, receive: Any, send: Any) -> None:
            async def sent(message: Any) -> None:
                if message["type"] != "http.response.start" or not self._much_is_left(cycle):
                    await send(message)
                    return
                self._leaves_body, cycle.keep_alive = True, False  # so uvicorn sends Connection: close,
                await send(message)
                cycle.keep_alive = True  # and leaves the closing to `_leave`

            async def received() -> Any:
                if not self._body_wanted:
                    self._body_wanted = True
                    self._read_at_most(_READ_BYTES)
                message = await receive()
                if message["type"] == "http.disconnect" and cycle.body:  # which uvicorn would drop
                    content, cycle.body = bytes(cycle.body), bytearray()
                    return {"type": "http.request", "body": content, "more_body": True}
                return message

            await app(scope, received, sent)

        super()._start_asgi_task(cycle, leaving_body)

    def _waits_for_app(self) -> bool:
        """Whether the application has not asked for the body yet; it is read once it does or responds."""
        cycle = self.cycle
        unread = cycle is not None and cycle.more_body and not cycle.response_complete
        return unread and not self._body_wanted

    def _read_at_most(self, size_bytes: int) -> None:
        # One call handles what one read returns: a small one leaves the loop to others in between.
        self.transport.max_size = size_bytes  # type: ignore[attr-defined]

    def _much_is_left(self, cycle: RequestResponseCycle) -> bool:
        declared = self._declared_bytes
        return cycle.more_body and (declared is None or declared - self._body_bytes > _DISCARDED_BYTES)

    def _leave(self) -> None:
        self._unset_keepalive_if_required()
        self._stop_head_deadline()
        self.flow.pause_reading()
        if self.transport.can_write_eof():
            self.transport.write_eof()
        self._head_deadline = self.loop.call_later(_LEAVE_S, self.transport.abort)

    def _watch(self) -> None:
        if self.cycle is not None and not self.cycle.response_complete:
            self._stop_head_deadline()  # the body has limits of its own
        elif self._head_deadline is None:
            self._head_deadline = self.loop.call_later(self.head_within_s, self.transport.close)

    def _stop_head_deadline(self) -> None:
        if self._head_deadline is not None:
            self._head_deadline.cancel()
            self._head_deadline = None

    def _stop_read_deadline(self) -> None:
        if self._read_deadline is not None:
            self._read_deadline.cancel()
            self._read_deadline = None


def http_protocol(head_within_s: float, *, read_within_s: float = READ_WITHIN_S) -> type[HttpToolsProtocol]:
    """The uvicorn protocol with these limits."""
    limits = {"head_within_s": head_within_s, "read_within_s": read_within_s}
    return type("LimitedProtocol", (_LimitedProtocol,), limits)
