"""A bad link on loopback: a proxy for HTTP that is slow, breaks, answers in the service's place, and is away.

It counts the bytes that enter the link on either side, also those that a break loses. Not simulated: what TCP
hides (reordered and lost packets) and the headers of TCP and IP.
"""

import asyncio
import contextlib
import random
import re
import socket
import struct
import threading
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass

_BLOCK_BYTES = 2048
_OVERSLEPT_S = 0.02
_LENGTH = re.compile(rb"\r\ncontent-length: *(\d+)", re.IGNORECASE)
_MOST_HEAD_BYTES = 65_536


@dataclass(frozen=True)
class LinkQuality:
    """How bad a link is."""

    rate_bytes_s: float = 20_000.0
    """In each direction, of all connections together."""
    latency_s: float = 0.0
    """Of each direction. What is on its way is lost when the link breaks."""
    breaks_every_bytes: float | None = None
    """The mean of the exponentially distributed number of bytes after which all connections break."""
    failing_share: float = 0.0
    """Of the requests: half of these do not reach the service, the answer to the others gets lost."""
    whole_requests_only: bool = False
    """As behind a proxy that passes on requests when they are complete: what came of others is lost."""
    gap_every_s: float | None = None
    """After so long with a link there is none. Half of the connections break then, the others stall."""
    gap_s: float = 0.0
    """How long there is none."""


class LinkSimulator:
    """Runs the proxy in a thread; ``url`` is where clients find it."""

    def __init__(self, service_port: int, quality: LinkQuality, seed: int = 0) -> None:
        self._service_port, self.quality = service_port, quality
        self._random = random.Random(seed)
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._ready = threading.Event()
        self._open: set[asyncio.Transport] = set()
        self._sessions: set[asyncio.Task[None] | None] = set()  # asyncio itself holds them weakly
        self._free_at = {"up": 0.0, "down": 0.0}
        self._until_break = self._next_break()
        self._present = asyncio.Event()
        self.sent_bytes: Counter[str] = Counter()
        """Bytes that entered the link, ``up`` and ``down``."""
        self.events: Counter[str] = Counter()
        """Connections, requests, breaks, gaps and answers in the service's place."""
        self.port = 0

    def __enter__(self) -> "LinkSimulator":
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._stop.set)
        self._thread.join()

    @property
    def url(self) -> str:
        """Where the service is found through the link."""
        return f"http://127.0.0.1:{self.port}"

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        self._loop.run_until_complete(self._serve())
        self._loop.close()

    async def _serve(self) -> None:
        self._stop = asyncio.Event()
        self._present.set()
        listener = socket.create_server(("127.0.0.1", 0))
        listener.setsockopt(
            socket.SOL_SOCKET, socket.SO_RCVBUF, 4 * _BLOCK_BYTES
        )  # what waits there was not sent
        self.port = listener.getsockname()[1]
        server = await asyncio.start_server(self._accept, sock=listener, limit=2 * _BLOCK_BYTES)
        gaps = asyncio.create_task(self._make_gaps())
        self._ready.set()
        await self._stop.wait()
        gaps.cancel()
        server.close()
        self._break(self._open)
        others = asyncio.all_tasks() - {asyncio.current_task()}
        for task in others:
            task.cancel()
        await asyncio.gather(*others, return_exceptions=True)

    async def _make_gaps(self) -> None:
        while self.quality.gap_every_s is not None:
            await asyncio.sleep(self.quality.gap_every_s)
            self.events["gaps"] += 1
            self._present.clear()
            self._break({one for one in self._open if self._random.random() < 0.5})
            await asyncio.sleep(self.quality.gap_s)
            self._present.set()

    async def _accept(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._open.add(writer.transport)  # type: ignore[arg-type]
        self._sessions.add(session := asyncio.current_task())
        self.events["connections"] += 1
        try:
            if not self._present.is_set():
                _reset(writer)
                return
            await _Session(self, reader, writer).run()
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            _reset(writer)
        except asyncio.CancelledError:  # the simulator ends; asyncio would log it
            _reset(writer)
        finally:
            self._open.discard(writer.transport)  # type: ignore[arg-type]
            self._sessions.discard(session)
            writer.close()

    async def carry(self, direction: str, size_bytes: int) -> None:
        """Wait until so many bytes have entered the link; it may break meanwhile."""
        now = time.monotonic()  # what a sleep took too long is caught up with
        begins = max(self._free_at[direction], now - _OVERSLEPT_S)
        self._free_at[direction] = begins + size_bytes / self.quality.rate_bytes_s
        await asyncio.sleep(max(0.0, self._free_at[direction] - now))
        await self._present.wait()
        self.sent_bytes[direction] += size_bytes
        self._until_break -= size_bytes
        if self._until_break <= 0:
            self._until_break = self._next_break()
            self.events["breaks"] += 1
            self._break(set(self._open))

    def fate(self) -> str:
        """What becomes of a request: ``served``, ``refused`` or ``answer lost``."""
        self.events["requests"] += 1
        drawn = self._random.random() / self.quality.failing_share if self.quality.failing_share else 1.0
        fate = "refused" if drawn < 0.5 else "answer lost" if drawn < 1.0 else "served"
        self.events[fate] += 1
        return fate

    async def connect(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """A connection to the service; raises ``OSError``."""
        return await asyncio.open_connection("127.0.0.1", self._service_port)

    def _break(self, transports: set[asyncio.Transport]) -> None:
        for transport in transports:
            _linger_none(transport)
            transport.abort()

    def _next_break(self) -> float:
        mean = self.quality.breaks_every_bytes
        return float("inf") if mean is None else self._random.expovariate(1 / mean)


class _Session:
    """One connection of a client, and one of its own to the service."""

    def __init__(
        self, link: LinkSimulator, reader: asyncio.StreamReader, writer: asyncio.StreamWriter
    ) -> None:
        self._link, self._reader, self._writer = link, reader, writer
        self._service: tuple[asyncio.StreamReader, asyncio.StreamWriter] | None = None
        self._ended = False

    async def run(self) -> None:
        """Pass on one request after the other, until either side closes."""
        try:
            while await self._exchange():
                pass
        finally:
            if self._service is not None:
                self._service[1].close()

    async def _exchange(self) -> bool:
        head = await self._head(self._reader, "up")
        fate = self._link.fate()
        source = self._reader
        if self._link.quality.whole_requests_only:
            source = await self._whole_body(_length(head))
        if fate == "refused":
            await self._answer_instead(503)
            return False
        try:
            self._service = self._service or await self._link.connect()
        except OSError:  # the gateway is being started again
            await self._answer_instead(502)
            return False
        reader, writer = self._service
        sending = asyncio.create_task(self._send(head, source, writer))
        try:
            answer = await self._head(reader, None)
            if fate == "answer lost":
                await asyncio.wait_for(sending, None)
                await self._answer_instead(504)
                return False
            length = 0 if head.startswith(b"HEAD ") or b" 204 " in answer[:16] else _length(answer)
            await self._down(answer)
            await self._copy(reader, length, self._down, None)
            return sending.done() and b"connection: close" not in answer.lower()
        except (OSError, asyncio.IncompleteReadError):
            if not self._ended and not self._writer.transport.is_closing():
                await self._answer_instead(502)
            return False
        finally:
            sending.cancel()
            with contextlib.suppress(asyncio.CancelledError, OSError, asyncio.IncompleteReadError):
                await sending

    async def _whole_body(self, size_bytes: int) -> asyncio.StreamReader:
        """The body of a request, once it has come through the link."""
        body = asyncio.StreamReader()

        async def keep(block: bytes) -> None:
            body.feed_data(block)

        await self._copy(self._reader, size_bytes, keep, "up")
        body.feed_eof()
        return body

    async def _send(self, head: bytes, source: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Pass on a request; what is on its way when the link breaks does not arrive."""

        async def up(block: bytes) -> None:
            writer.write(block)
            await writer.drain()

        try:
            await asyncio.sleep(self._link.quality.latency_s)
            await up(head)
            await self._copy(source, _length(head), up, "up" if source is self._reader else None)
        except (OSError, asyncio.IncompleteReadError):
            writer.close()  # the service sees that the client has gone
            raise

    async def _copy(
        self, reader: asyncio.StreamReader, left: int, to: Callable[[bytes], object], direction: str | None
    ) -> None:
        late: asyncio.Queue[tuple[float, bytes]] = asyncio.Queue()

        async def deliver() -> None:
            while True:
                due, block = await late.get()
                await asyncio.sleep(max(0.0, due - time.monotonic()))
                if self._writer.transport.is_closing():
                    return
                await to(block)  # type: ignore[misc]
                late.task_done()

        delivering = asyncio.create_task(deliver())
        try:
            while left:
                block = await reader.read(min(left, _BLOCK_BYTES))
                if not block:
                    raise asyncio.IncompleteReadError(b"", left)
                if direction is not None:
                    await self._link.carry(direction, len(block))
                left -= len(block)
                late.put_nowait((time.monotonic() + self._link.quality.latency_s, block))
            waiting = asyncio.create_task(late.join())
            await asyncio.wait({waiting, delivering}, return_when=asyncio.FIRST_COMPLETED)
            waiting.cancel()
            if delivering.done():
                delivering.result()
                raise ConnectionResetError
        finally:
            delivering.cancel()

    async def _down(self, block: bytes) -> None:
        await self._link.carry("down", len(block))
        self._writer.write(block)
        await self._writer.drain()

    async def _head(self, reader: asyncio.StreamReader, direction: str | None) -> bytes:
        head = await reader.readuntil(b"\r\n\r\n")
        if len(head) > _MOST_HEAD_BYTES:
            raise ConnectionResetError
        if direction is not None:
            await self._link.carry(direction, len(head))
        return head

    async def _answer_instead(self, status: int) -> None:
        self._ended = True
        await asyncio.sleep(self._link.quality.latency_s)
        body = b"<html>no service</html>"
        head = f"HTTP/1.1 {status} Failed\r\nContent-Length: {len(body)}\r\nConnection: close\r\n\r\n"
        await self._down(head.encode() + body)
        # Let the answer arrive: closing with unread bytes of the request would reset the connection.
        self._writer.write_eof()
        ends = time.monotonic() + 0.5 + 2 * self._link.quality.latency_s
        with contextlib.suppress(TimeoutError):
            while block := await asyncio.wait_for(self._reader.read(_BLOCK_BYTES), ends - time.monotonic()):
                await self._link.carry("up", len(block))


def _length(head: bytes) -> int:
    found = _LENGTH.search(head)
    return 0 if found is None else int(found[1])


def _reset(writer: asyncio.StreamWriter) -> None:
    _linger_none(writer.transport)
    writer.transport.abort()


def _linger_none(transport: asyncio.BaseTransport) -> None:
    with contextlib.suppress(OSError, AttributeError):
        transport.get_extra_info("socket").setsockopt(
            socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0)
        )
