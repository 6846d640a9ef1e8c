"""Caddy with the configuration of ``deploy/proxy`` in front of a gateway: who is let in, what passes."""

import contextlib
import os
import signal
import socket
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import certificates
import grpc
import httpx2
import pytest
import uvicorn
from computing_runners import ComputingRunners
from conftest_of import conftest_of
from contract_outcome import outcome_of_error
from fvs.v1.scenes_pb2 import GetSceneRequest, WatchEventsRequest
from fvs.v1.scenes_pb2_grpc import SceneServiceStub
from fvs_client import (
    NO_RETRIES,
    Client,
    ConnectionFailedError,
    FvsError,
    UnauthenticatedError,
)
from fvs_service.gateway.connection import http_protocol
from fvs_service.serving.gateway import GatewayServer
from fvs_service.serving.rest_app import create_app
from fvs_service.settings import Settings
from gateways import Gateway, migrate, settings_for
from grpc_health.v1.health_pb2 import HealthCheckRequest
from grpc_health.v1.health_pb2_grpc import HealthStub
from proxy_server import Proxy, caddy, running_proxy
from tus_device import TYPE, VERSION, Device

from fvs_schema.artifacts import CAMERAS, GAUSSIANS

photograph = conftest_of("fvs_service").photograph
pytestmark = pytest.mark.system

_NAMES = ("localhost", "ground.example", "other.example")
_HEAD_WITHIN_S = 10.0
_UPLOAD_IDLE_S = 1.0
_WITHIN_S = 30.0


@dataclass
class Proxied:
    """A gateway behind a proxy, and a key for it."""

    gateway: Gateway
    proxy: Proxy
    key: str

    @property
    def trust(self) -> ssl.SSLContext:
        """Trusts the proxy's authority."""
        return ssl.create_default_context(cafile=str(self.proxy.authority))

    @property
    def headers(self) -> dict[str, str]:
        """Of requests with the key."""
        return {"Authorization": f"Bearer {self.key}"}

    @contextlib.contextmanager
    def client(self, key: str | None, trust: ssl.SSLContext | None = None) -> Iterator[Client]:
        """The Python client, through the proxy."""
        context = trust or self.trust
        with Client(self.proxy.url, key, ssl_context=context, retries=NO_RETRIES) as client:
            yield client

    @contextlib.contextmanager
    def channel(self, key: Path | None = None, certificate: Path | None = None) -> Iterator[grpc.Channel]:
        """A channel through the proxy."""
        credentials = grpc.ssl_channel_credentials(
            self.proxy.authority.read_bytes(),
            key and key.read_bytes(),
            certificate and certificate.read_bytes(),
        )
        with grpc.secure_channel(self.proxy.url.removeprefix("https://"), credentials) as channel:
            yield channel

    @contextlib.contextmanager
    def connection(self) -> Iterator[ssl.SSLSocket]:
        """A connection to the proxy, for what no client would do."""
        with (
            socket.create_connection(("127.0.0.1", self.proxy.port), _WITHIN_S) as plain,
            self.trust.wrap_socket(plain, server_hostname="localhost") as connection,
        ):
            yield connection


@contextlib.contextmanager
def _served(settings: Settings) -> Iterator[tuple[Gateway, str, str]]:
    """A gateway on free ports, with a client of its own, and the URLs of REST and gRPC."""
    migrate(settings)
    app = create_app(settings, ComputingRunners)
    ports: list[int | None] = []
    config = uvicorn.Config(app, port=0, log_level="error", http=http_protocol(), proxy_headers=False)
    server = GatewayServer(config, app, settings, ports.append)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not ports:
        assert thread.is_alive()
        time.sleep(0.01)
    url = f"http://127.0.0.1:{server.servers[0].sockets[0].getsockname()[1]}"
    try:
        with httpx2.Client(base_url=url, timeout=_WITHIN_S) as client:
            yield Gateway(app, client, settings), url, f"grpc://127.0.0.1:{ports[0]}"
    finally:
        server.handle_exit(signal.SIGTERM, None)
        thread.join()


@pytest.fixture(scope="module")
def open_proxied(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Callable[..., Proxied]]:
    """Start a proxy in front of a gateway."""
    if caddy() is None:
        missing = "Caddy is not installed: apt-get install caddy"
        if os.environ.get("CI") == "true":
            pytest.fail(missing)
        pytest.skip(missing)
    with contextlib.ExitStack() as stack:

        def start(**options: Any) -> Proxied:
            folder = tmp_path_factory.mktemp("proxied")
            overrides = {
                "require_keys": True,
                "grpc_port": 0,
                "allowed_hosts": ("ground.example",),
                "upload_idle_s": _UPLOAD_IDLE_S,
            }
            settings = settings_for(folder / "service", overrides)
            gateway, rest, rpc = stack.enter_context(_served(settings))
            key = gateway.application.storage.keys.create("test")
            proxy = stack.enter_context(running_proxy(folder / "proxy", rest, rpc, names=_NAMES, **options))
            return Proxied(gateway, proxy, key)

        yield start


@pytest.fixture(scope="module")
def proxied(open_proxied: Callable[..., Proxied]) -> Proxied:
    return open_proxied()


@pytest.fixture
def http(proxied: Proxied) -> Iterator[httpx2.Client]:
    """An HTTP client with the key."""
    with httpx2.Client(
        base_url=proxied.proxy.url, headers=proxied.headers, verify=proxied.trust, timeout=_WITHIN_S
    ) as client:
        yield client


@pytest.fixture
def scene(proxied: Proxied) -> str:
    return proxied.gateway.scene(proxied.headers)


def test_rest_and_grpc_share_a_port_and_need_a_key(proxied: Proxied, scene: str) -> None:
    with proxied.client(proxied.key) as client:
        assert client.scenes.get(scene).id == scene
    for key in (None, "fvs_0000_wrong"):
        with proxied.client(key) as client, pytest.raises(UnauthenticatedError):
            client.scenes.get(scene)
    with proxied.channel() as channel:
        get = SceneServiceStub(channel).GetScene
        metadata = [("authorization", f"Bearer {proxied.key}")]
        assert get(GetSceneRequest(scene_id=scene), metadata=metadata, timeout=_WITHIN_S).id == scene
        with pytest.raises(grpc.RpcError) as refused:
            get(GetSceneRequest(scene_id=scene), timeout=_WITHIN_S)
        assert outcome_of_error(refused.value).code == "unauthenticated"
        # Who needs no key is not let in from outside.
        with pytest.raises(grpc.RpcError) as refused:
            HealthStub(channel).Check(HealthCheckRequest(), timeout=_WITHIN_S)
        assert refused.value.code() is grpc.StatusCode.UNIMPLEMENTED


def test_who_does_not_trust_or_forgets_the_s_is_told(proxied: Proxied) -> None:
    with (
        proxied.client(proxied.key, ssl.create_default_context()) as client,
        pytest.raises(ConnectionFailedError, match="There is no secure connection to") as refused,
    ):
        client.capabilities()
    assert "SSL_CERT_FILE" in refused.value.hint
    with (
        Client(proxied.proxy.url.replace("s://", "://"), proxied.key, retries=NO_RETRIES) as client,
        pytest.raises(FvsError, match="not from an fvs service"),
    ):
        client.capabilities()


@pytest.mark.parametrize(
    ("host", "status"), [("localhost", 200), ("ground.example", 200), ("other.example", 421)]
)
def test_the_gateway_checks_the_name_that_the_client_used(
    http: httpx2.Client, host: str, status: int
) -> None:
    spoofed = {"X-Forwarded-Host": "ground.example", "X-Forwarded-For": "127.0.0.1"}
    answer = http.get("/v1/scenes", headers={"Host": host, **spoofed}, extensions={"sni_hostname": host})
    assert answer.status_code == status


def test_an_upload_that_is_cut_resumes_at_its_last_byte(
    proxied: Proxied, http: httpx2.Client, scene: str, photograph: Callable[..., bytes]
) -> None:
    content = photograph(1) + bytes(1_000_000)
    device, arrived = Device(http, scene, content, proxied.headers), 300_000
    assert device.create().status_code == 201
    fields = {**proxied.headers, **VERSION, **TYPE, "Upload-Offset": 0, "Content-Length": len(content)}
    head = "".join(f"{name}: {value}\r\n" for name, value in fields.items())
    with proxied.connection() as connection:
        connection.sendall(f"PATCH {device.url} HTTP/1.1\r\nHost: localhost\r\n{head}\r\n".encode())
        for start in range(0, arrived, 10_000):  # as a link does
            connection.sendall(content[start : start + 10_000])
            time.sleep(0.01)
    until = time.monotonic() + _WITHIN_S
    while device.offset != arrived:
        assert time.monotonic() < until, device.offset
        time.sleep(0.05)
    assert device.patch(arrived).status_code == 204
    assert device.image()["verdict"] == "accepted"


def test_the_log_of_the_proxy_has_addresses_and_no_keys(proxied: Proxied, http: httpx2.Client) -> None:
    answer = http.get("/v1/capabilities")
    until = time.monotonic() + _WITHIN_S
    while answer.headers["x-request-id"] not in (log := proxied.proxy.log.read_text()):
        assert time.monotonic() < until
        time.sleep(0.05)
    assert '"remote_ip":"127.0.0.1"' in log
    assert proxied.key not in log


def test_events_come_at_once(proxied: Proxied, http: httpx2.Client, scene: str) -> None:
    def queued() -> None:
        proxied.gateway.queue(scene, headers=proxied.headers)

    with http.stream("GET", f"/v1/scenes/{scene}/events") as answer:
        lines = answer.iter_lines()
        assert any(line == "event: scene.created" for line in lines)
        queued()
        assert any(line == "event: job.queued" for line in lines)
    with proxied.channel() as channel:
        metadata = [("authorization", f"Bearer {proxied.key}")]
        asked = WatchEventsRequest(scene_id=scene)
        watched = SceneServiceStub(channel).WatchEvents(asked, metadata=metadata, timeout=_WITHIN_S)
        kinds = (event.kind for event in watched)
        first = next(kinds)
        queued()
        assert next(kinds) != first
        watched.cancel()


def test_json_is_compressed_and_files_are_left_alone(
    proxied: Proxied, http: httpx2.Client, scene: str
) -> None:
    for number in range(12):
        proxied.gateway.scene(proxied.headers, name=f"yard {number}")
    listed = http.get("/v1/scenes")
    assert listed.headers["content-encoding"] == "gzip"
    assert len(listed.json()["items"]) > 12
    assert "content-encoding" not in http.get("/v1/scenes", headers={"Accept-Encoding": "identity"}).headers
    snapshot = proxied.gateway.model(scene, proxied.headers, images=30)
    for name in (CAMERAS, GAUSSIANS):
        whole = http.get(f"/v1/snapshots/{snapshot}/artifacts/{name}")
        assert "etag" in whole.headers
        assert "content-encoding" not in whole.headers
        part = http.get(f"/v1/snapshots/{snapshot}/artifacts/{name}", headers={"Range": "bytes=100-1999"})
        assert (part.status_code, part.content) == (206, whole.content[100:2_000])
    page = http.get("/", headers={"Accept": "text/html"})
    assert page.headers["content-encoding"] == "gzip"
    assert "script-src 'self'" in page.headers["content-security-policy"]
    assert "<title>" in page.text


def test_heads_and_bodies_have_limits(proxied: Proxied, http: httpx2.Client, scene: str) -> None:
    assert http.get("/livez", headers={"a": "b" * 40_000}).status_code == 431
    too_large = http.post(f"/v1/scenes/{scene}/rankings", content=b"[" * 10_000_000)
    assert (too_large.status_code, too_large.json()["code"]) == (413, "payload-too-large")
    nobody = http.put(
        f"/v1/scenes/{scene}/images/sha256:{'0' * 64}",
        content=b"a" * 10_000_000,
        headers={"Authorization": ""},
    )
    assert nobody.status_code == 401
    with proxied.connection() as connection:  # the gateway's patience, whose answer comes through
        path = f"/v1/scenes/{scene}/images/sha256:{'0' * 64}"
        head = f"PUT {path} HTTP/1.1\r\nHost: localhost\r\nAuthorization: Bearer {proxied.key}\r\n"
        connection.sendall(f"{head}Content-Length: 1000000\r\n\r\nonly this".encode())
        time.sleep(2 * _UPLOAD_IDLE_S)
        connection.sendall(b"more")  # Go's server does not answer before it has read
        assert connection.recv(64).startswith(b"HTTP/1.1 408 ")
    with proxied.connection() as connection:
        began = time.monotonic()
        connection.sendall(b"GET / HTTP/1.1\r\nX-Never: en")
        connection.recv(100)
        assert time.monotonic() - began < _HEAD_WITHIN_S + 5


def test_only_certificates_of_the_authority_are_let_in(
    open_proxied: Callable[..., Proxied], tmp_path: Path
) -> None:
    known = certificates.made_for_tests(tmp_path)
    proxied = open_proxied(client_authority=known["ours"])
    scene = proxied.gateway.scene(proxied.headers)
    for own in (known["client"], known["stranger"], None):
        trust = proxied.trust
        if own is not None:
            trust.load_cert_chain(own, own.with_suffix(".key"))
        asked, metadata = GetSceneRequest(scene_id=scene), [("authorization", f"Bearer {proxied.key}")]
        with (
            proxied.client(proxied.key, trust) as client,
            proxied.channel(own and own.with_suffix(".key"), own) as channel,
        ):
            get = SceneServiceStub(channel).GetScene
            if own == known["client"]:
                assert client.scenes.get(scene).id == scene
                assert get(asked, metadata=metadata, timeout=_WITHIN_S).id == scene
                continue
            with pytest.raises(ConnectionFailedError, match=r"The connection to .* broke") as refused:
                client.capabilities()
            assert "a certificate of its authority" in refused.value.hint
            with pytest.raises(grpc.RpcError) as failed:
                get(asked, metadata=metadata, timeout=5)
            assert failed.value.code() is grpc.StatusCode.UNAVAILABLE
