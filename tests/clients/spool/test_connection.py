"""What a spool's connection does with a service that answers early, late or not at all."""

import io
import socket
import ssl
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

import certificates
import pytest
from fvs_client.spool.connection import Connection, Part, Target, UnreadableFileError
from fvs_client.spool.errors import LinkError, SpoolError
from fvs_client.spool.pace import Pace

pytestmark = pytest.mark.process
_BODY_BYTES = 20_000_000
_OK = b"HTTP/1.1 200 OK\r\nContent-Length: 2\r\n\r\n{}"


class Peer:
    """A server that does what it is told with each connection."""

    def __init__(self, act: Callable[[socket.socket], None], tls: ssl.SSLContext | None = None) -> None:
        self._act, self._tls = act, tls
        self._listener = socket.create_server(("127.0.0.1", 0))
        self.connections = 0
        self.port = self._listener.getsockname()[1]
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while True:
            try:
                accepted, _ = self._listener.accept()
            except OSError:
                return
            self.connections += 1
            with accepted:
                try:
                    self._serve(accepted)
                except OSError:
                    continue

    def _serve(self, accepted: socket.socket) -> None:
        if self._tls is None:
            self._act(accepted)
            return
        with self._tls.wrap_socket(accepted, server_side=True) as secured:
            self._act(secured)

    def close(self) -> None:
        self._listener.shutdown(socket.SHUT_RDWR)
        self._listener.close()
        self._thread.join(5)


@pytest.fixture
def peer() -> Iterator[Callable[..., Peer]]:
    made: list[Peer] = []

    def make(act: Callable[[socket.socket], None], tls: ssl.SSLContext | None = None) -> Peer:
        made.append(Peer(act, tls))
        return made[-1]

    yield make
    for one in made:
        one.close()


def _head(peer: socket.socket) -> bytes:
    received = b""
    while b"\r\n\r\n" not in received:
        block = peer.recv(65_536)
        if not block:
            raise ConnectionResetError
        received += block
    return received


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return certificates.made_for_tests(tmp_path_factory.mktemp("certificates"))


@pytest.mark.system
@pytest.mark.parametrize("secure", [False, True])
def test_a_refusal_that_comes_early_stops_the_body(
    peer: Callable[..., Peer], known: dict[str, Path], monkeypatch: pytest.MonkeyPatch, secure: bool
) -> None:
    received = []

    def refuse(accepted: socket.socket) -> None:
        body = len(_head(accepted).partition(b"\r\n\r\n")[2])
        accepted.sendall(b"HTTP/1.1 503 No\r\nContent-Length: 2\r\nRetry-After: 3\r\n\r\n{}")
        while block := accepted.recv(4096):
            body += len(block)
        received.append(body)

    tls = None
    if secure:
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(known["service"], known["service"].with_suffix(".key"))
        monkeypatch.setenv("SSL_CERT_FILE", str(known["ours"]))
    server = peer(refuse, tls)
    sent: list[int] = []
    # Slow enough for the answer to come before the end; a megabyte per second is a hundred times the wait.
    connection = Connection(_target(server, secure), Pace(1_000_000.0), timeout_s=10.0)
    body = Part(io.BytesIO(bytes(_BODY_BYTES)), 0, _BODY_BYTES, sent.append)
    answer = connection.ask("PUT", "/", {}, body)
    connection.close()
    assert (answer.status, answer.headers["retry-after"], answer.content) == (503, "3", b"{}")
    assert answer.early
    assert sum(sent) < _BODY_BYTES / 20


def test_a_whole_body_arrives(peer: Callable[..., Peer]) -> None:
    content = bytes(range(256)) * 1_000
    received = []

    def take(accepted: socket.socket) -> None:
        for _ in range(2):
            body = _head(accepted).partition(b"\r\n\r\n")[2]
            while len(body) < len(content) - 56:
                body += accepted.recv(65_536)
            received.append(body)
            accepted.sendall(_OK)

    server = peer(take)
    connection = Connection(_target(server), Pace(None), timeout_s=5.0)
    for _ in range(2):
        part = Part(io.BytesIO(content), 56, len(content) - 56)
        assert connection.ask("PATCH", "/", {}, part).document == {}
    connection.close()
    assert received == [content[56:]] * 2
    assert server.connections == 1


def test_a_connection_that_the_service_has_closed_is_opened_again(peer: Callable[..., Peer]) -> None:
    closed = threading.Event()

    def answer_once(accepted: socket.socket) -> None:
        _head(accepted)
        accepted.sendall(_OK)
        accepted.close()
        closed.set()

    server = peer(answer_once)
    connection = Connection(_target(server), Pace(None), timeout_s=5.0)
    for _ in range(3):
        closed.clear()
        assert connection.ask("GET", "/").status == 200
        assert closed.wait(5)
    connection.close()
    assert server.connections == 3


@pytest.mark.parametrize(
    "answer",
    [b"", b"HTTP/1.1 2", b"nonsense\r\n\r\n", b"HTTP/1.1 200 OK\r\nContent-Length: 9\r\n\r\n{}"],
)
def test_an_answer_that_breaks_off_is_a_failure_of_the_link(peer: Callable[..., Peer], answer: bytes) -> None:
    def break_off(accepted: socket.socket) -> None:
        _head(accepted)
        accepted.sendall(answer)

    connection = Connection(_target(peer(break_off)), Pace(None), timeout_s=5.0)
    with pytest.raises(LinkError) as caught:
        connection.ask("GET", "/")
    assert not caught.value.answered


def test_a_port_that_speaks_another_protocol_is_named(peer: Callable[..., Peer]) -> None:
    def speak(accepted: socket.socket) -> None:
        _head(accepted)
        accepted.sendall(b"\x00\x00\x1e\x04\x00\x00")

    server = peer(speak)
    with pytest.raises(LinkError, match="does not answer in HTTP") as caught:
        Connection(_target(server), Pace(None), timeout_s=5.0).ask("GET", "/")
    assert "gRPC" in caught.value.hint


def test_a_service_that_says_nothing_is_a_failure_of_the_link(peer: Callable[..., Peer]) -> None:
    silent = threading.Event()
    server = peer(lambda _accepted: silent.wait(5) and None)
    connection = Connection(_target(server), Pace(None), timeout_s=0.1)
    with pytest.raises(LinkError, match="does not answer"):
        connection.ask("GET", "/")
    silent.set()


def test_a_certificate_that_is_not_trusted_names_the_clock(
    peer: Callable[..., Peer], known: dict[str, Path]
) -> None:
    tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
    tls.load_cert_chain(known["service"], known["service"].with_suffix(".key"))
    connection = Connection(_target(peer(_head, tls), secure=True), Pace(None), timeout_s=5.0)
    with pytest.raises(LinkError, match="certificate") as caught:
        connection.ask("GET", "/")
    assert "clock" in caught.value.hint


def test_a_file_that_becomes_shorter_is_no_failure_of_the_link(peer: Callable[..., Peer]) -> None:
    def listen(accepted: socket.socket) -> None:
        while accepted.recv(65_536):
            pass

    connection = Connection(_target(peer(listen)), Pace(None), timeout_s=5.0)
    with pytest.raises(UnreadableFileError):
        connection.ask("PATCH", "/", {}, Part(io.BytesIO(b"short"), 0, 100))


@pytest.mark.parametrize(
    "url", ["http://host/fvs", "http://host/fvs/", "http://host/fvs/v1", "http://host/fvs/v1/"]
)
def test_a_url_may_have_the_prefix_of_the_routes(url: str) -> None:
    assert Target.resolve(url, None).url == "http://host/fvs"


@pytest.mark.parametrize("url", ["host:8000", "grpc://host:8001", "http://", "ftp://host"])
def test_a_url_that_is_none_is_refused(url: str) -> None:
    with pytest.raises(SpoolError, match="not a URL that the spool can use"):
        Target.resolve(url, None)


def _target(peer: Peer, secure: bool = False) -> Target:
    return Target(f"http{'s' if secure else ''}://127.0.0.1:{peer.port}", "key")
