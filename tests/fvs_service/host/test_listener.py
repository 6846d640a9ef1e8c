"""What connections without the secret can do to a runner."""

import contextlib
import errno
import logging
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator
from types import SimpleNamespace
from typing import Any

import pytest
from fvs_service.host.protocol import connection as connection_module
from fvs_service.host.protocol.connection import Connection, RunnerGoneError, connect
from fvs_service.host.runner import listener as listener_module
from fvs_service.host.runner.listener import Listener

SECRET = "secret"


def _echo(connection: Connection) -> None:
    with contextlib.suppress(RunnerGoneError):
        while True:
            connection.send(connection.receive())


@pytest.fixture
def listener() -> Iterator[Listener]:
    listener = Listener("127.0.0.1", SECRET, _echo)
    socket_, before = listener._socket, threading.active_count()
    yield listener
    with contextlib.suppress(OSError):
        socket_.shutdown(socket.SHUT_RDWR)  # wakes the thread that accepts
    socket_.close()
    while threading.active_count() > before:
        time.sleep(0.01)


def _listen(listener: Listener) -> threading.Thread:
    thread = threading.Thread(target=listener.listen, daemon=True)
    thread.start()
    return thread


def _answers(listener: Listener) -> bool:
    host, port = listener.address
    connection = connect(f"{host}:{port}/{SECRET}", 30.0)
    connection.set_timeout(30.0)
    try:
        connection.send([1])
        return bool(connection.receive() == [1])
    finally:
        connection.close()


def _failing_once(original: Callable[..., Any], error: Exception) -> Callable[..., Any]:
    failures = [error]

    def call(*arguments: Any, **options: Any) -> Any:
        if failures:
            raise failures.pop()
        return original(*arguments, **options)

    return call


@pytest.mark.parametrize("fails", ["accept", "thread"])
def test_a_listener_goes_on_when_descriptors_or_threads_run_out(
    listener: Listener, monkeypatch: pytest.MonkeyPatch, fails: str
) -> None:
    if fails == "accept":
        original = listener._socket
        accept = _failing_once(original.accept, OSError(errno.EMFILE, "Too many open files"))
        failing = SimpleNamespace(accept=accept, fileno=original.fileno, getsockname=original.getsockname)
        monkeypatch.setattr(listener, "_socket", failing)
        thread = _listen(listener)
    else:
        thread = _listen(listener)
        start = _failing_once(threading.Thread, RuntimeError("can't start new thread"))
        failing = SimpleNamespace(Thread=start, Lock=threading.Lock)
        monkeypatch.setattr(listener_module, "threading", failing)
        with pytest.raises(RunnerGoneError):
            _answers(listener)  # this connection is lost, the next is not
    assert _answers(listener)
    assert thread.is_alive()


def test_connections_that_send_no_secret_are_closed_for_newer_ones(
    listener: Listener, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(listener_module, "_GREETING_S", 600.0)
    _listen(listener)
    with contextlib.ExitStack() as open_ones:
        strangers = [
            open_ones.enter_context(socket.create_connection(listener.address, 30.0))
            for _ in range(listener_module._STRANGERS + 1)
        ]
        ready, _, _ = select.select(strangers, [], [], 30.0)
        assert [stranger.recv(1) for stranger in ready] == [b""]  # the oldest, before its time is up
        assert _answers(listener)


def test_the_first_line_must_arrive_whole_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = SimpleNamespace(now=0.0)

    def monotonic() -> float:
        clock.now += 1.0
        return float(clock.now)

    monkeypatch.setattr(connection_module, "time", SimpleNamespace(monotonic=monotonic))
    ours, theirs = socket.socketpair(socket.AF_UNIX)
    with ours, theirs:
        monkeypatch.setattr(connection_module, "keep_alive", lambda _: None)
        received = Connection(ours)
        dripping = threading.Event()

        def drip() -> None:
            with contextlib.suppress(OSError):
                while not dripping.wait(0.01):
                    theirs.send(b"x")

        thread = threading.Thread(target=drip)
        thread.start()
        try:
            with pytest.raises(RunnerGoneError, match="in time"):
                received.receive_first_line(10_000, 20.0)
        finally:
            dripping.set()
            thread.join()
            received.close()


def test_the_request_that_follows_the_secret_at_once_is_not_lost(listener: Listener) -> None:
    _listen(listener)
    with socket.create_connection(listener.address, 30.0) as client:
        client.sendall(b'{"secret":"secret"}\n[2]\n')
        assert client.makefile("rb").readline() == b"[2]\n"


@pytest.mark.parametrize(
    "line", [b"GET / HTTP/1.1\r\n", b"\xff\n", b'{"secret":"\\ud800"}\n', b"[]\n", b'{"secret":"wrong"}\n']
)
def test_strangers_fill_no_log(listener: Listener, caplog: pytest.LogCaptureFixture, line: bytes) -> None:
    _listen(listener)
    with caplog.at_level(logging.DEBUG):
        for _ in range(5):
            with socket.create_connection(listener.address, 30.0) as client:
                client.sendall(line)
                with contextlib.suppress(ConnectionError):
                    assert client.recv(1) == b""
    (record,) = caplog.records
    assert record.exc_info is None
    assert "did not begin with the secret" in record.getMessage()
