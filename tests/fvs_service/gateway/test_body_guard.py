"""Bodies that drip, that are encoded, and clients that hang up."""

import contextlib
import hashlib
import secrets
import select
import socket
import threading
import time
from collections.abc import Iterator
from typing import Any

import pytest

_UNKNOWN = hashlib.sha256(b"never").hexdigest()


@contextlib.contextmanager
def _upload(server: Any, scene: str, key: str = "") -> Iterator[socket.socket]:
    """A connection that has sent the head of an upload."""
    url = server.client.base_url
    head = f"PUT /v1/scenes/{scene}/images/sha256:{secrets.token_hex(32)} HTTP/1.1\r\nHost: localhost\r\n"
    head += f"Authorization: {key}\r\n" if key else ""
    with socket.create_connection((url.host, url.port)) as connection:
        connection.settimeout(20)
        connection.sendall(f"{head}Content-Length: 1000000\r\n\r\n".encode())
        yield connection


def _drip(connection: socket.socket, every_s: float, stop: threading.Event) -> None:
    with contextlib.suppress(OSError):
        while not stop.wait(every_s):
            connection.sendall(b"a")


def _until_staged(server: Any, uploads: int) -> None:
    """Wait until so many uploads have places."""
    deadline = time.monotonic() + 20
    while len(list(server.settings.uploads.rglob("*.part"))) < uploads:
        assert time.monotonic() < deadline
        time.sleep(0.01)


def test_a_dripped_body_frees_its_place_for_others(serve: Any, photograph: Any) -> None:
    server = serve(upload_grace_s=0.6, upload_bytes_per_s=1_000, limits={"open_uploads_per_tenant": 1})
    scene, stop = server.scene(), threading.Event()
    with _upload(server, scene) as connection:
        dripping = threading.Thread(target=_drip, args=(connection, 0.05, stop))
        dripping.start()
        try:
            _until_staged(server, 1)
            answer = connection.recv(4096)
            while not answer.endswith(b"}"):
                answer += connection.recv(4096)
        finally:
            stop.set()
            dripping.join()
    assert b" 408 " in answer.split(b"\r\n")[0]
    assert b"1000 bytes per second" in answer
    assert server.put(scene, photograph(2)).status_code == 201


def test_slow_uploads_of_one_key_give_a_place_to_another_key(serve: Any, photograph: Any) -> None:
    server = serve(
        require_keys=True,
        upload_grace_s=2.0,
        upload_bytes_per_s=1,
        limits={"open_uploads_per_tenant": 2},
    )
    slow, other = server.key("tenant"), server.key("tenant")
    scene, key = server.scene(slow), slow["Authorization"]
    with _upload(server, scene, key) as first, _upload(server, scene, key) as second:
        stop = threading.Event()
        threads = [threading.Thread(target=_drip, args=(one, 0.02, stop)) for one in (first, second)]
        for thread in threads:
            thread.start()
        try:
            _until_staged(server, 2)
            answer = server.put(scene, photograph(2), headers=other)
            deadline = time.monotonic() + 20
            while answer.status_code == 429 and time.monotonic() < deadline:  # within the grace period
                assert answer.headers["Retry-After"] in ("1", "2")
                time.sleep(0.05)
                answer = server.put(scene, photograph(2), headers=other)
            ended, _, _ = select.select([first, second], [], [], 20)
        finally:
            stop.set()
            for thread in threads:
                thread.join()
        assert answer.status_code == 201, answer.text
        assert len(ended) == 1
        assert b" 408 " in ended[0].recv(4096).split(b"\r\n")[0]


def test_a_fast_start_does_not_pay_for_a_slow_rest(serve: Any) -> None:
    server = serve(upload_grace_s=0.5, upload_bytes_per_s=1_000)
    scene, stop = server.scene(), threading.Event()
    with _upload(server, scene) as connection:
        connection.sendall(b"a" * 500_000)
        dripping = threading.Thread(target=_drip, args=(connection, 0.05, stop))
        dripping.start()
        try:
            assert b" 408 " in connection.recv(4096).split(b"\r\n")[0]
        finally:
            stop.set()
            dripping.join()


def test_encoded_bodies_are_refused(gateway: Any) -> None:
    sent = {"Content-Type": "application/json", "Content-Encoding": "gzip"}
    answer = gateway.client.post("/v1/scenes", content=b"\x1f\x8b", headers=sent)
    assert (answer.status_code, answer.json()["code"]) == (415, "unsupported-media-type")
    sent["Content-Encoding"] = "identity"
    assert gateway.client.post("/v1/scenes", content=b'{"name":"a"}', headers=sent).status_code == 201


def test_endless_queries_are_refused(gateway: Any) -> None:
    query = "&".join(f"k{number}=1" for number in range(65))
    assert gateway.client.get(f"/v1/scenes?{query}").status_code == 422


@pytest.mark.parametrize("kind", ["PUT", "form", "JSON"])
def test_a_client_that_hangs_up_is_no_failure_of_the_service(
    serve: Any, kind: str, capfd: pytest.CaptureFixture[str]
) -> None:
    server = serve()
    scene, url = server.scene(), server.client.base_url
    path, sent = {
        "PUT": (f"PUT /v1/scenes/{scene}/images/sha256:{_UNKNOWN}", "application/octet-stream"),
        "form": (f"POST /v1/scenes/{scene}/images", "multipart/form-data; boundary=b"),
        "JSON": ("POST /v1/scenes", "application/json"),
    }[kind]
    with socket.create_connection((url.host, url.port)) as connection:
        head = f"{path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: {sent}\r\nContent-Length: 9999\r\n\r\n"
        connection.sendall(head.encode() + b"--b")
        time.sleep(0.1)
    deadline = time.monotonic() + 20
    while 'status="499"' not in server.client.get("/metrics").text:
        assert time.monotonic() < deadline
    assert 'status="500"' not in server.client.get("/metrics").text
    assert "Traceback" not in capfd.readouterr().err
