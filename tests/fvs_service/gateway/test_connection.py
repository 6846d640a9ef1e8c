import contextlib
import json
import resource
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import httpx2
import pytest
import uvicorn
from fvs_service.gateway.connection import http_protocol
from fvs_service.serving import gateway as server

_PATIENCE_S = 0.5


async def _answer(_scope: Any, receive: Any, send: Any) -> None:
    while (await receive()).get("more_body"):
        pass
    headers = [(b"content-length", b"2")]
    await send({"type": "http.response.start", "status": 200, "headers": headers})
    await send({"type": "http.response.body", "body": b"ok"})


@contextlib.contextmanager
def _serving(app: Any) -> Iterator[tuple[uvicorn.Server, tuple[str, int]]]:
    protocol = http_protocol(_PATIENCE_S)
    config = uvicorn.Config(app, port=0, log_level="critical", lifespan="off", http=protocol)
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not server.started:
        assert thread.is_alive()
        time.sleep(0.01)
    try:
        yield server, server.servers[0].sockets[0].getsockname()
    finally:
        server.should_exit = True
        thread.join()


@pytest.fixture(scope="module")
def address() -> Iterator[tuple[str, int]]:
    with _serving(_answer) as (_, address):
        yield address


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


@pytest.mark.parametrize(
    "head",
    [
        b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 200 + b"\r\n",
        b"POST / HTTP/1.1\r\nTransfer-Encoding: chunked\r\n\r\n0\r\n" + b"a: b\r\n" * 200,
        b"GET / HTTP/1.1\r\n\r\n" * 2_000,
    ],
    ids=["headers", "trailers", "pipelined"],
)
def test_headers_and_requests_at_once_have_limits(connection: socket.socket, head: bytes) -> None:
    received = _sent(connection, head)
    assert received.count(b"HTTP/1.1 200") <= 16
    assert b"HTTP/1.1 400" in received or not received.endswith(b"ok")


@pytest.mark.parametrize(
    ("sent", "reason"),
    [
        (b"GET / HTTP/1.1\r\n" + b"a: b\r\n" * 200, "more than 100 headers"),
        (b"\x16\x03\x01\x02\x00\x01\x00", "not an HTTP/1.1 request"),
        (b"GET / SMTP\r\n\r\n", "not an HTTP/1.1 request"),
    ],
    ids=["head", "TLS", "another protocol"],
)
def test_a_refused_head_gets_a_problem_document(connection: socket.socket, sent: bytes, reason: str) -> None:
    head, _, body = _sent(connection, sent).partition(b"\r\n\r\n")
    assert head.startswith(b"HTTP/1.1 400 ")
    assert b"content-type: application/problem+json" in head
    problem = json.loads(body)
    assert (problem["status"], problem["code"], problem["retryable"]) == (400, "malformed-request", False)
    assert reason in problem["detail"]
    assert f"x-request-id: {problem['request_id']}".encode() in head


def test_bodies_in_chunks_of_a_byte_are_refused(connection: socket.socket) -> None:
    head = b"POST / HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\n"
    assert b"HTTP/1.1 200" not in _sent(connection, head + b"1\r\na\r\n" * 20_000 + b"0\r\n\r\n")


async def _refuse(_scope: Any, _receive: Any, send: Any) -> None:
    """An answer that needs no body."""
    await send({"type": "http.response.start", "status": 401, "headers": [(b"content-length", b"2")]})
    await send({"type": "http.response.body", "body": b"no"})


@pytest.fixture(scope="module")
def refusing() -> Iterator[tuple[str, int]]:
    with _serving(_refuse) as (_, address):
        yield address


@pytest.mark.parametrize("size", [1_000, 2_000_000])
def test_a_client_that_sends_all_of_a_body_first_gets_the_response(
    refusing: tuple[str, int], size: int
) -> None:
    with httpx2.Client(base_url="http://{}:{}".format(*refusing), timeout=60) as client:
        for _ in range(2):
            answer = client.put("/", content=b"a" * size)
            assert (answer.status_code, answer.content) == (401, b"no")


def test_a_connection_outlives_a_small_body_that_nobody_needs(refusing: tuple[str, int]) -> None:
    with socket.create_connection(refusing) as connection:
        connection.settimeout(60)
        for _ in range(2):
            connection.sendall(b"PUT / HTTP/1.1\r\nHost: a\r\nContent-Length: 20000\r\n\r\n")
            assert _body(connection) == b"no"
            connection.sendall(b"a" * 20_000)


def test_a_head_may_follow_a_body_in_one_read(connection: socket.socket) -> None:
    body = b"PUT / HTTP/1.1\r\nHost: a\r\nContent-Length: 60000\r\n\r\n" + b"a" * 60_000
    connection.sendall(body + b"GET / HTTP/1.1\r\nHo")
    assert _body(connection) == b"ok"
    connection.sendall(b"st: a\r\n\r\n")
    assert _body(connection) == b"ok"


def test_bodies_in_a_few_small_chunks_are_read(connection: socket.socket) -> None:
    head = b"POST / HTTP/1.1\r\nHost: a\r\nTransfer-Encoding: chunked\r\n\r\n"
    connection.sendall(head + b"1\r\na\r\n" * 200 + b"0\r\n\r\n")
    assert _body(connection) == b"ok"


def _sent(connection: socket.socket, request: bytes) -> bytes:
    """All that the server answers until it closes the connection."""
    received = b""
    try:
        connection.sendall(request)
        while part := connection.recv(65_536):
            received += part
    except ConnectionError:
        pass
    return received


async def _answer_much(_scope: Any, _receive: Any, send: Any) -> None:
    await send({"type": "http.response.start", "status": 200, "headers": []})
    for _ in range(1_000):
        await send({"type": "http.response.body", "body": b"a" * 100_000, "more_body": True})
    await send({"type": "http.response.body", "body": b""})


def test_who_does_not_read_is_cut_off() -> None:
    with _serving(_answer_much) as (server, address), socket.create_connection(address) as connection:
        connection.sendall(b"GET / HTTP/1.1\r\nHost: a\r\n\r\n")
        deadline = time.monotonic() + 20
        while not server.server_state.connections:
            assert time.monotonic() < deadline
            time.sleep(0.01)
        while server.server_state.connections:
            assert time.monotonic() < deadline, "the connection is kept"
            time.sleep(0.01)


@pytest.mark.parametrize(
    ("limits", "raised"),
    [
        ((1_024, 4_096), [(4_096, 4_096)]),
        ((1_024, resource.RLIM_INFINITY), [(65_536, resource.RLIM_INFINITY)]),
        ((100_000, 200_000), []),
    ],
)
def test_the_gateway_may_open_as_many_files_as_the_system_allows(
    monkeypatch: pytest.MonkeyPatch, limits: tuple[int, int], raised: list[tuple[int, int]]
) -> None:
    seen: list[tuple[int, int]] = []
    monkeypatch.setattr(resource, "getrlimit", lambda _: limits)
    monkeypatch.setattr(resource, "setrlimit", lambda _, changed: seen.append(changed))
    server._allow_many_connections()
    assert seen == raised
