"""HTTP over one connection, for links that break: it listens while it sends, and sends at a pace."""

import functools
import http.client
import importlib.metadata
import io
import socket
import ssl
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import BinaryIO
from urllib.parse import urlsplit

from fvs_client.service_url import DEFAULT_URL, base_url
from fvs_client.spool.answers import Answer
from fvs_client.spool.errors import LinkError, SpoolError
from fvs_client.spool.pace import Pace

_ANSWER_BLOCK_BYTES = 16 << 10
_UNSENT_BYTES = 4 << 10
"""Size of the kernel's send buffer: all of it is lost with the connection."""
_LARGEST_ANSWER_BYTES = 1 << 20
_ANSWER_TIMEOUTS = 4
"""The answer to the last byte, which tells the verdict, may take so many times as long as a byte."""


@dataclass(frozen=True)
class Target:
    """The service: its URL, and the API key or None."""

    url: str
    api_key: str | None

    @classmethod
    def resolve(cls, url: str | None, api_key: str | None) -> "Target":
        """Check a URL, by default that of this machine. Raises ``SpoolError``."""
        chosen = base_url(url)
        parts = urlsplit(chosen)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise SpoolError(
                f"{chosen!r} is not a URL that the spool can use.",
                hint=f"Give http(s)://…, such as {DEFAULT_URL}.",
            )
        return cls(chosen, api_key or None)


@dataclass(frozen=True)
class Part:
    """A part of a file as the body of a request; ``on_sent`` gets the size of every block that left."""

    file: BinaryIO
    start: int
    size_bytes: int
    on_sent: Callable[[int], object] = lambda _: None


class Connection:
    """A connection to the service, kept between requests, opened again when it broke."""

    def __init__(self, target: Target, pace: Pace, timeout_s: float) -> None:
        self._target, self._pace, self._timeout_s = target, pace, timeout_s
        parts = urlsplit(target.url)
        self._prefix = parts.path
        self._tls = ssl.create_default_context() if parts.scheme == "https" else None
        self._open: http.client.HTTPConnection | None = None

    def close(self) -> None:
        """Close it; the next request opens a new one."""
        if self._open is not None:
            self._open.close()
        self._open = None

    def ask(
        self, method: str, path: str, headers: Mapping[str, str] | None = None, body: Part | bytes = b""
    ) -> Answer:
        """Return the answer to a request, whatever it is. Raises ``LinkError``, ``UnreadableFileError``."""
        try:
            connection = self._connected()
            early = self._send(connection, method, path, headers or {}, body)
            if early is None:
                connection.sock.settimeout(self._timeout_s * _ANSWER_TIMEOUTS)
                response = connection.getresponse()
            else:
                response = http.client.HTTPResponse(_Heard(early, self._socket), method=method)  # type: ignore[arg-type]
                response.begin()
            content = response.read(_LARGEST_ANSWER_BYTES)
            if response.length:  # http.client does not report an answer that broke off
                raise http.client.IncompleteRead(content, response.length)
            if early is not None or not response.isclosed():
                self.close()
        except (OSError, http.client.HTTPException) as error:
            self.close()
            raise self._failure(error) from error
        except BaseException:
            self.close()
            raise
        received = {name.lower(): value for name, value in response.getheaders()}
        return Answer(response.status, received, content, early is not None)

    def _connected(self) -> http.client.HTTPConnection:
        # Closed by the service, after its last answer or since.
        if self._open is not None and (self._open.sock is None or self._heard() is not None):
            self.close()
        if self._open is None:
            parts = urlsplit(self._target.url)
            assert parts.hostname is not None
            if self._tls is None:
                self._open = http.client.HTTPConnection(parts.hostname, parts.port, self._timeout_s)
            else:
                self._open = http.client.HTTPSConnection(
                    parts.hostname, parts.port, timeout=self._timeout_s, context=self._tls
                )
            self._open.connect()
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if hasattr(socket, "TCP_NOTSENT_LOWAT"):
                self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NOTSENT_LOWAT, _UNSENT_BYTES)
        self._socket.settimeout(self._timeout_s)
        return self._open

    @property
    def _socket(self) -> socket.socket:
        assert self._open is not None
        return self._open.sock

    def _send(
        self,
        connection: http.client.HTTPConnection,
        method: str,
        path: str,
        headers: Mapping[str, str],
        body: Part | bytes,
    ) -> bytes | None:
        """Send a request; returns the beginning of an answer that came before its end."""
        connection.putrequest(method, self._prefix + path, skip_accept_encoding=True)
        connection.putheader("User-Agent", _user_agent())
        if self._target.api_key is not None:
            connection.putheader("Authorization", f"Bearer {self._target.api_key}")
        for name, value in headers.items():
            connection.putheader(name, value)
        size = len(body) if isinstance(body, bytes) else body.size_bytes
        if size or method in ("POST", "PUT", "PATCH"):
            connection.putheader("Content-Length", str(size))
        if isinstance(body, bytes):
            connection.endheaders(body or None)
            return None
        connection.endheaders()
        return self._send_part(body)

    def _send_part(self, part: Part) -> bytes | None:
        left = part.size_bytes
        while left:
            block = _read(part, part.start + part.size_bytes - left, min(left, self._pace.block_bytes))
            self._pace.spend(len(block))
            if (early := self._heard()) is not None:
                return early
            try:
                self._socket.sendall(block)
            except OSError:
                if early := self._heard():  # it sent the reason before it closed
                    return early
                raise
            part.on_sent(len(block))
            left -= len(block)
        return None

    def _heard(self) -> bytes | None:
        """Bytes that have arrived, without waiting: None for none, empty when the other side has closed."""
        held = self._socket.gettimeout()
        self._socket.settimeout(0.0)
        try:
            return self._socket.recv(_ANSWER_BLOCK_BYTES)
        except (BlockingIOError, ssl.SSLWantReadError):
            return None
        except OSError:
            return b""
        finally:
            self._socket.settimeout(held)

    def _failure(self, error: Exception) -> LinkError:
        if isinstance(error, ssl.SSLCertVerificationError):
            return LinkError(
                f"The certificate of {self._target.url} is not accepted: {error.verify_message}.",
                hint="Is this machine's clock right? SSL_CERT_FILE names a file of certificates to trust.",
            )
        if isinstance(error, TimeoutError):
            return LinkError(f"{self._target.url} does not answer.")
        if isinstance(error, http.client.BadStatusLine) and not isinstance(error, OSError):
            return LinkError(
                f"{self._target.url} does not answer in HTTP.",
                hint="Is the URL right? The port of gRPC is another one than that of HTTP.",
            )
        return LinkError(f"No connection to {self._target.url}: {str(error) or type(error).__name__}.")


class UnreadableFileError(Exception):
    """A file cannot be read, or has become shorter, while it is sent."""


def _read(part: Part, start: int, size_bytes: int) -> bytes:
    try:
        part.file.seek(start)
        block = part.file.read(size_bytes)
    except OSError as error:  # of the card, not of the link
        raise UnreadableFileError(str(error)) from error
    if not block:
        raise UnreadableFileError("it has become shorter")
    return block


@functools.cache
def _user_agent() -> str:
    return f"fvs-client/{importlib.metadata.version('fvs-client')}"


class _Heard:
    """A socket some of whose bytes were read already, for ``HTTPResponse``."""

    def __init__(self, first: bytes, rest: socket.socket) -> None:
        self._first, self._rest = first, rest

    def makefile(self, _mode: str) -> io.BufferedReader:
        return io.BufferedReader(_Joined(self._first, self._rest))


class _Joined(io.RawIOBase):
    def __init__(self, first: bytes, rest: socket.socket) -> None:
        self._first, self._rest = first, rest

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        if self._first:
            size = min(len(buffer), len(self._first))
            buffer[:size], self._first = self._first[:size], self._first[size:]
            return size
        return self._rest.recv_into(buffer)
