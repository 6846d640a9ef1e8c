import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest
import uvicorn
from fvs_service.gateway.connection import http_protocol

_PATIENCE_S = 0.5


async def _answer(_scope: Any, receive: Any, send: Any) -> None:
    while (await receive()).get("more_body"):
        pass
    headers = [(b"content-length", b"2")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": b"ok"})


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    protocol = http_protocol(_PATIENCE_S)
    config = uvicorn.Config(_answer, port=0, log_level="error", lifespan="off", http=protocol)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.01)
    yield server.servers[0].sockets[0].getsockname()
    server.should_exit = True
    thread.join()


@pytest.fixture
def connection(address: tuple[str, int]) -> Iterator[socket.socket]:
    with socket.create_connection(address) as connection:
        connection.settimeout(20)
        yield connection


def _body(connection: socket.socket) -> bytes:
    """Of an answer with two bytes of content."""
    received = b""
    while not received.partition(b"\r\n\r\n")[2][1:]:
        received += connection.recv(1000)
    return received.partition(b"\r\n\r\n")[2]


def _is_closed_after(connection: socket.socket, drop: bytes) -> bool:
    try:
        connection.sendall(drop)
        return connection.recv(100) == b""
    except TimeoutError:
        return False
    except ConnectionError:
        return True


@pytest.mark.parametrize("head", [b"", b"GET / HT", b"GET / HTTP/1.1\r\nHost: a\r\nX-Never: en"])
def test_who_never_ends_a_head_is_let_go(connection: socket.socket, head: bytes) -> None:
    connection.sendall(head)
    assert connection.recv(100) == b""


def test_heads_that_come_in_drops_have_no_longer(connection: socket.socket) -> None:
    connection.sendall(b"GET / HTTP/1.1\r\n")
    connection.settimeout(_PATIENCE_S / 5)
    assert any(_is_closed_after(connection, b"X-%d: a\r\n" % number) for number in range(400))


def test_the_next_request_of_a_connection_has_its_own_time(connection: socket.socket) -> None:
    for _ in range(2):
        connection.sendall(b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
        assert _body(connection) == b"ok"
    connection.sendall(b"GET / HTTP/1.1\r\nHo")
    assert connection.recv(100) == b""


def test_a_body_may_take_longer_than_a_head(connection: socket.socket) -> None:
    connection.sendall(b"PUT / HTTP/1.1\r\nHost: a\r\nContent-Length: 2\r\n\r\na")
    time.sleep(2 * _PATIENCE_S)
    connection.sendall(b"b")
    assert _body(connection) == b"ok"
