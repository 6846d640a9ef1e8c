"""Connections to a runner from an event loop: cancelling a request closes its connection."""

import asyncio
import contextlib
from collections.abc import AsyncGenerator
from typing import Any

import orjson
from anyio.to_thread import run_sync

from fvs_service.host.protocol.connection import MAX_LINE_BYTES, RunnerError, RunnerGoneError, keep_alive
from fvs_service.host.protocol.messages import Failure

_CONNECT_S = 2.0
_KEPT_CONNECTIONS = 8


class AsyncConnection:
    """A connection of one event loop, for one request at a time."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    async def send(self, request: bytes) -> None:
        """Send a request as JSON; raises ``RunnerGoneError``."""
        try:
            self._writer.write(request + b"\n")
            await self._writer.drain()
        except OSError as error:
            raise RunnerGoneError("The connection is broken.") from error

    async def receive(self) -> bytes:
        """The next document as JSON; raises ``RunnerGoneError``."""
        try:
            line = await self._reader.readline()
        except (OSError, ValueError) as error:  # ValueError: a line that is too long
            raise RunnerGoneError("The connection is broken.") from error
        if not line.endswith(b"\n"):
            raise RunnerGoneError("The other side has closed the connection.")
        return line

    @property
    def ended(self) -> bool:
        """Whether the other side has closed the connection, which nothing waits for."""
        return self._reader.at_eof() or self._writer.is_closing()

    def close(self) -> None:
        """Close the connection at once: the runner then drops the request, unless others wait for it."""
        self._writer.transport.abort()


async def connect(endpoint: str) -> AsyncConnection:
    """Connect to a runner; ``endpoint`` is ``host:port/secret``. Raises ``RunnerGoneError``."""
    address, secret = endpoint.split("/", 1)
    host, port = address.rsplit(":", 1)
    try:
        async with asyncio.timeout(_CONNECT_S):
            reader, writer = await asyncio.open_connection(host, int(port), limit=MAX_LINE_BYTES)
    except OSError as error:  # TimeoutError is one
        raise RunnerGoneError(f"No runner listens at {address}.") from error
    keep_alive(writer.get_extra_info("socket"))
    writer.write(orjson.dumps({"secret": secret}) + b"\n")
    return AsyncConnection(reader, writer)


class AsyncConnections:
    """Connections that are kept for the next request.

    A new runner has a new endpoint, so nobody asks for connections to the one before it again. asyncio leaves
    the socket open when the other side closes it: each call closes all that have ended.
    """

    def __init__(self) -> None:
        self._free: dict[str, list[AsyncConnection]] = {}

    async def call(self, endpoint: str, request: bytes) -> bytes:
        """The response over a kept connection, or over a new one if there is none or it was cut.

        Raises ``RunnerGoneError``.
        """
        self._close_ended()
        if kept := self._free.get(endpoint):
            with contextlib.suppress(RunnerGoneError):
                return await self._use(endpoint, kept.pop(), request)
            for connection in self._free.pop(endpoint, ()):
                connection.close()
        return await self._use(endpoint, await connect(endpoint), request)

    def close(self) -> None:
        """Close all connections that are kept."""
        for connections in self._free.values():
            for connection in connections:
                connection.close()
        self._free.clear()

    async def _use(self, endpoint: str, connection: AsyncConnection, request: bytes) -> bytes:
        try:
            await connection.send(request)
            response = await connection.receive()
        except BaseException:  # cancelled, too: the runner notices that nobody waits any longer
            connection.close()
            raise
        kept = self._free.setdefault(endpoint, [])
        if len(kept) < _KEPT_CONNECTIONS:
            kept.append(connection)
        else:
            connection.close()
        return response

    def _close_ended(self) -> None:
        for endpoint, connections in list(self._free.items()):
            for connection in [one for one in connections if one.ended]:
                connection.close()
                connections.remove(connection)
            if not connections:
                del self._free[endpoint]


async def exchange(endpoint: str, request: bytes) -> AsyncGenerator[Any, None]:
    """Send a request over a connection of its own; yields what ``connection.exchange`` does.

    Large documents are read in a thread. Raises ``RunnerError`` when the response is an error,
    ``RunnerGoneError``.
    """
    connection = await connect(endpoint)
    try:
        await connection.send(request)
        while True:
            document = await run_sync(_document, await connection.receive())
            yield document
            if "result" in document:
                return
    finally:
        connection.close()


def result_of(response: bytes) -> Any:
    """The result in a response; raises ``RunnerError`` when it is an error."""
    return _document(response)["result"]


def _document(line: bytes) -> Any:
    document = orjson.loads(line)
    if "error" in document:
        raise RunnerError(Failure.model_validate(document["error"]))
    return document
