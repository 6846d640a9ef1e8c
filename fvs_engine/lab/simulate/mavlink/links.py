"""The connections of ground stations: TCP and UDP, any number of each.

Names of links are pymavlink's, as the autopilot sees them: ``tcpin:HOST:PORT``, ``udpin:HOST:PORT`` and
``udpout:HOST:PORT``.
"""

import contextlib
import select
import socket
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from fvs_engine.lab.simulate.mavlink.dialect import mavlink
from fvs_engine.lab.simulate.mavlink.signing import sign_by

_READ_BYTES = 65_536
_MOST_WAITING_BYTES = 1 << 20
"""A station that reads nothing for so long is disconnected."""


@dataclass(eq=False)
class Peer:
    """A ground station that signs by ``key``; ``address`` is where a datagram goes, None for TCP."""

    socket: socket.socket
    address: tuple[str, int] | None
    key: bytes | None
    parser: Any = field(init=False)
    waiting: bytearray = field(default_factory=bytearray)

    def __post_init__(self) -> None:
        self.parser = mavlink.MAVLink(None)
        self.parser.robust_parsing = True
        sign_by(self.key, self.parser)


class Links:
    """Receives from all stations and sends to them; with a ``key``, only what is signed by it is received.

    Raises ``ValueError`` for a name that is none, and ``OSError`` where it cannot be opened.
    """

    def __init__(self, names: Iterable[str], key: bytes | None = None) -> None:
        self._key = key
        self.urls: list[str] = []
        """Where stations connect, in pymavlink's names of their ends."""
        self._servers: list[socket.socket] = []
        self._datagrams: list[socket.socket] = []
        self._peers: list[Peer] = []
        for name in names:
            self._open(*_parts(name))

    def close(self) -> None:
        """End all connections."""
        for each in {*self._servers, *self._datagrams, *(peer.socket for peer in self._peers)}:
            each.close()

    def receive(self, seconds: float) -> Iterator[tuple[Peer, Any]]:
        """Wait up to ``seconds`` for messages, and yield those that have come, with their senders."""
        streams = [peer.socket for peer in self._peers if peer.address is None]
        ready, _, _ = select.select([*self._servers, *self._datagrams, *streams], [], [], seconds)
        for each in ready:
            if each in self._servers:
                connected, _ = each.accept()
                connected.setblocking(False)
                connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                self._peers.append(Peer(connected, None, self._key))
                continue
            for peer, data in self._read(each):
                for message in peer.parser.parse_buffer(data) or ():
                    if message.get_type() != "BAD_DATA":
                        yield peer, message

    def send(self, data: bytes, only: Peer | None = None, but: Peer | None = None) -> None:
        """Send to all stations, to one, or to all but one."""
        for peer in list(self._peers):
            if peer is but or (only is not None and peer is not only):
                continue
            with contextlib.suppress(OSError):
                if peer.address is not None:
                    peer.socket.sendto(data, peer.address)
                    continue
            if peer.address is None:
                self._write(peer, data)

    def _open(self, kind: str, host: str, port: int) -> None:
        if kind == "tcpin":
            server = socket.create_server((host, port))
            server.setblocking(False)
            self._servers.append(server)
            host, port = server.getsockname()[:2]
            self.urls.append(f"tcp:{host}:{port}")
            return
        datagrams = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        datagrams.setblocking(False)
        self._datagrams.append(datagrams)
        if kind == "udpin":
            datagrams.bind((host, port))
            host, port = datagrams.getsockname()
            self.urls.append(f"udpout:{host}:{port}")
        else:
            self._peers.append(Peer(datagrams, (socket.gethostbyname(host), port), self._key))
            self.urls.append(f"udpin:{host}:{port}")

    def _read(self, source: socket.socket) -> list[tuple[Peer, bytes]]:
        """The data on a socket and whom they are from; an end closes the connection."""
        found = []
        if source in self._datagrams:
            with contextlib.suppress(OSError):
                while True:
                    data, address = source.recvfrom(_READ_BYTES)
                    found.append((self._at(source, address), data))
            return found
        peer = next((peer for peer in self._peers if peer.socket is source), None)
        if peer is None:  # it was disconnected since
            return []
        try:
            data = source.recv(_READ_BYTES)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._drop(peer)
            return []
        return [(peer, data)]

    def _at(self, source: socket.socket, address: tuple[str, int]) -> Peer:
        for peer in self._peers:
            if peer.socket is source and peer.address == address:
                return peer
        self._peers.append(Peer(source, address, self._key))
        return self._peers[-1]

    def _write(self, peer: Peer, data: bytes) -> None:
        peer.waiting += data
        try:
            while peer.waiting:
                del peer.waiting[: peer.socket.send(peer.waiting)]
        except BlockingIOError:
            if len(peer.waiting) > _MOST_WAITING_BYTES:
                self._drop(peer)
        except OSError:
            self._drop(peer)

    def _drop(self, peer: Peer) -> None:
        self._peers.remove(peer)
        peer.socket.close()


def _parts(name: str) -> tuple[str, str, int]:
    kind, _, rest = name.partition(":")
    host, _, port = rest.rpartition(":")
    if kind not in ("tcpin", "udpin", "udpout") or not host:
        raise ValueError(f"{name!r} is no tcpin:HOST:PORT, udpin:HOST:PORT or udpout:HOST:PORT")
    return kind, host, int(port)
