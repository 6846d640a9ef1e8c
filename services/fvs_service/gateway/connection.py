"""HTTP connections with limits on what one request may take of the event loop before its client is known.

Limits on heads and on slow clients are the proxy's. The parser is llhttp: h11, in Python, holds the event
loop for a second when a body comes in chunks of a byte.
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

_MAX_HEADERS = 100
_MAX_PIPELINED = 8
_SMALL_PIECE_BYTES, _FREE_PIECES = 64, 256
"""A body may have this many pieces of any size; all of its pieces must then be larger on average."""

_HEAD = f"The request has more than {_MAX_HEADERS} headers."
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
    """Refuses requests with too many headers or pieces of a body, and too many at once.

    It also cuts connections whose client has read so little in ``read_within_s`` that the response's buffer
    stays full: a proxy that streams responses waits for its own client.
    """

    read_within_s: float
    _read_deadline: asyncio.TimerHandle | None = None
    _in_head = True
    _exceeded = ""
    _headers_seen = _pieces = _body_bytes = 0

    def connection_lost(self, exc: Exception | None) -> None:
        self._stop_read_deadline()
        super().connection_lost(exc)

    def on_message_begin(self) -> None:
        if len(self.pipeline) >= _MAX_PIPELINED:
            self._refuse(_PIPELINE)
        super().on_message_begin()
        self._in_head = True
        self._headers_seen = self._pieces = self._body_bytes = 0

    def on_header(self, name: bytes, value: bytes) -> None:
        self._headers_seen += 1
        if self._headers_seen > _MAX_HEADERS:
            self._refuse(_HEAD)
        if self._in_head:  # others are trailers of a chunked body
            super().on_header(name, value)

    def on_headers_complete(self) -> None:
        self._in_head = False
        super().on_headers_complete()

    def on_body(self, body: bytes) -> None:
        self._pieces += 1
        self._body_bytes += len(body)
        if self._pieces > _FREE_PIECES and self._body_bytes < self._pieces * _SMALL_PIECE_BYTES:
            self._refuse(_CHUNKS)
        super().on_body(body)

    def pause_writing(self) -> None:
        super().pause_writing()
        if self._read_deadline is None:
            self._read_deadline = self.loop.call_later(self.read_within_s, self.transport.abort)

    def resume_writing(self) -> None:
        self._stop_read_deadline()
        super().resume_writing()

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
        async def with_all_that_arrived(scope: Any, receive: Any, send: Any) -> None:
            async def received() -> Any:
                message = await receive()
                if message["type"] == "http.disconnect" and cycle.body:  # which uvicorn would drop
                    content, cycle.body = bytes(cycle.body), bytearray()
                    return {"type": "http.request", "body": content, "more_body": True}
                return message

            await app(scope, received, send)

        super()._start_asgi_task(cycle, with_all_that_arrived)

    def _stop_read_deadline(self) -> None:
        if self._read_deadline is not None:
            self._read_deadline.cancel()
            self._read_deadline = None


def http_protocol(read_within_s: float = READ_WITHIN_S) -> type[HttpToolsProtocol]:
    """The uvicorn protocol with these limits."""
    return type("LimitedProtocol", (_LimitedProtocol,), {"read_within_s": read_within_s})
