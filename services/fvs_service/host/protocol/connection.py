"""Connections to runners: one JSON document per line over TCP, one request at a time.

The first line of a connection is the runner's secret. See ``messages`` for what follows.
"""

import contextlib
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import orjson

from fvs_engine.records import Record
from fvs_service.host.protocol.messages import Failure

MAX_LINE_BYTES = 64_000_000
_NO_FIRST_LINE = "The first line did not arrive whole and in time."
_LEAST_TIMEOUT_S = 0.001
"""A timeout of 0 would mean not to wait at all."""


def keep_alive(connection: socket.socket) -> None:
    """Send small messages at once, and notice within 15 s that the other machine is gone."""
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_KEEPALIVE, 1)
    for option, value in (("TCP_KEEPIDLE", 5), ("TCP_KEEPINTVL", 3), ("TCP_KEEPCNT", 3)):
        if hasattr(socket, option):
            connection.setsockopt(socket.IPPROTO_TCP, getattr(socket, option), value)
    if hasattr(socket, "TCP_USER_TIMEOUT"):
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, 15_000)


class RunnerError(Exception):
    """The runner's response is an error."""

    def __init__(self, failure: Failure) -> None:
        super().__init__(failure.message)
        self.failure = failure


class RunnerGoneError(Exception):
    """The runner, or the connection to it, ended before the response."""


class Connection:
    """Either end of a connection between a runner and its client; ``send`` may be called from any thread."""

    def __init__(self, connection: socket.socket) -> None:
        keep_alive(connection)
        self._connection = connection
        self._file = connection.makefile("rb")
        self._sending = threading.Lock()

    def send(self, document: Any) -> None:
        """Send one document, in which records may be; raises ``RunnerGoneError``."""
        line = orjson.dumps(document, default=_fragment) + b"\n"
        try:
            with self._sending:
                self._connection.sendall(line)
        except OSError as error:
            raise RunnerGoneError("The connection is broken.") from error

    def receive_line(self) -> bytes:
        """The next document as JSON; raises ``RunnerGoneError`` when the connection has ended."""
        try:
            line = self._file.readline(MAX_LINE_BYTES)
        except OSError as error:
            raise RunnerGoneError("The connection is broken.") from error
        if not line.endswith(b"\n"):
            raise RunnerGoneError("The other side has closed the connection.")
        return line

    def receive_first_line(self, max_bytes: int, timeout_s: float) -> bytes:
        """The first line, which must arrive whole within ``timeout_s``; raises ``RunnerGoneError``."""
        until = time.monotonic() + timeout_s
        line = b""
        try:
            while not line.endswith(b"\n") and len(line) < max_bytes:
                self._connection.settimeout(max(_LEAST_TIMEOUT_S, until - time.monotonic()))
                arrived = self._file.peek(1)
                if not arrived or time.monotonic() > until:
                    break
                line += self._file.readline(min(len(arrived), max_bytes - len(line)))
            self._connection.settimeout(None)
        except OSError as error:
            raise RunnerGoneError(_NO_FIRST_LINE) from error
        if not line.endswith(b"\n"):
            raise RunnerGoneError(_NO_FIRST_LINE)
        return line

    def receive(self) -> Any:
        """The next document; raises ``RunnerGoneError`` when the connection has ended."""
        return orjson.loads(self.receive_line())

    def set_timeout(self, seconds: float | None) -> None:
        """Limit each send and receive to ``seconds``; None: no limit."""
        self._connection.settimeout(seconds)

    def ended(self) -> bool:
        """Whether the other side has closed the connection; to be called while it waits for a response."""
        try:
            return not self._connection.recv(1, socket.MSG_PEEK | socket.MSG_DONTWAIT)
        except BlockingIOError:
            return False
        except OSError:
            return True

    def end(self) -> None:
        """End the connection from another thread: who receives gets ``RunnerGoneError``."""
        with contextlib.suppress(OSError):
            self._connection.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        """Close the connection."""
        self._file.close()
        self._connection.close()


def _fragment(part: Any) -> orjson.Fragment:
    """A record as JSON, not through Python objects."""
    if not isinstance(part, Record):
        raise TypeError
    return orjson.Fragment(part.model_dump_json())


def connect(endpoint: str, timeout_s: float) -> Connection:
    """Connect to a runner; ``endpoint`` is ``host:port/secret``. Raises ``RunnerGoneError``."""
    address, secret = endpoint.split("/", 1)
    host, port = address.rsplit(":", 1)
    try:
        connection = Connection(socket.create_connection((host, int(port)), timeout_s))
    except OSError as error:
        raise RunnerGoneError(f"No runner listens at {address}.") from error
    connection.send({"secret": secret})
    return connection


def exchange(connection: Connection, request: Record) -> Iterator[Any]:
    """Send a request; yields the documents with a ``part``, then the one with the ``result``.

    Raises ``RunnerError`` when the response is an error, ``RunnerGoneError``.
    """
    connection.send(request)
    while True:
        document = connection.receive()
        if "error" in document:
            raise RunnerError(Failure.model_validate(document["error"]))
        yield document
        if "result" in document:
            return


def result_of(connection: Connection, request: Record) -> Any:
    """Send a request and return its result; documents before it are ignored. Raises as ``exchange``."""
    return next(document["result"] for document in exchange(connection, request) if "result" in document)


def call(endpoint: str, request: Record, timeout_s: float) -> Any:
    """The result of a request over a connection of its own. Raises as ``exchange``."""
    connection = connect(endpoint, timeout_s)
    try:
        connection.set_timeout(timeout_s)
        return result_of(connection, request)
    finally:
        connection.close()
