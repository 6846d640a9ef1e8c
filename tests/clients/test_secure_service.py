"""A service with keys, TLS and certificates of clients: who is let in, and what others are told."""

import signal
import ssl
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import certificates
import pytest
import uvicorn
from computing_runners import ComputingRunners
from fvs_client import NO_RETRIES, Client, ConnectionFailedError, ForbiddenError, UnauthenticatedError
from fvs_service.principal import Scope
from fvs_service.serving.gateway import GatewayServer, certificates_of
from fvs_service.serving.rest_app import create_app
from gateways import settings_for

Connect = Callable[..., Client]


@pytest.fixture(scope="module")
def known(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return certificates.made_for_tests(tmp_path_factory.mktemp("certificates"))


@pytest.fixture(scope="module", params=[False, True], ids=["tls", "mtls"])
def secure(
    request: pytest.FixtureRequest, known: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Any]:
    """A gateway with TLS; with mTLS it asks clients for certificates, too."""
    service = known["service"]
    tls = {"tls_certificate": service, "tls_key": service.with_suffix(".key")}
    if request.param:
        tls["tls_client_ca"] = known["ours"]
    settings = settings_for(
        tmp_path_factory.mktemp("secure") / "service", {"require_keys": True, "grpc": False, **tls}
    )
    app = create_app(settings, ComputingRunners)
    ports: list[int | None] = []
    config = uvicorn.Config(app, port=0, log_level="error", **certificates_of(settings))
    server = GatewayServer(config, app, settings, ports.append)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not ports:
        assert thread.is_alive()
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    app.state.url = f"https://127.0.0.1:{port}"
    yield app.state
    server.handle_exit(signal.SIGTERM, None)
    thread.join()


@pytest.fixture
def connect(secure: Any, known: dict[str, Path]) -> Connect:
    """Connect with an API key, a CA and a client certificate, each named by its entry in ``known``."""

    def open_client(key: str | None, trusted: str = "ours", own: str | None = "client") -> Client:
        mine = None if own is None else known[own]
        context = ssl.create_default_context(cafile=str(known[trusted]))
        if mine is not None:
            context.load_cert_chain(mine, mine.with_suffix(".key"))
        return Client(secure.url, key, ssl_context=context, retries=NO_RETRIES)

    return open_client


def _key(secure: Any, **options: Any) -> str:
    created: str = secure.application.storage.keys.create("test", **options)
    return created


def test_a_key_opens_a_secure_service(secure: Any, connect: Connect) -> None:
    with connect(_key(secure)) as client:
        scene = client.scenes.create("quarry")
        assert client.scenes.get(scene.id) == scene
        assert client.health().status == "ok"


def test_a_key_is_needed_and_must_permit_the_call(secure: Any, connect: Connect) -> None:
    for key in (None, "fvs_0000_wrong"):
        with connect(key) as client, pytest.raises(UnauthenticatedError) as refused:
            client.scenes.create("quarry")
        assert "fvs keys create" in refused.value.hint or "key" in refused.value.message
    with connect(_key(secure, scopes=frozenset({Scope.READ}))) as client, pytest.raises(ForbiddenError):
        client.scenes.create("quarry")


def test_a_service_that_is_not_trusted_is_not_called(secure: Any, connect: Connect) -> None:
    with (
        connect(_key(secure), trusted="foreign") as client,
        pytest.raises(ConnectionFailedError, match="There is no secure connection to") as refused,
    ):
        client.capabilities()
    assert "SSL_CERT_FILE" in refused.value.hint


@pytest.mark.system
@pytest.mark.parametrize("own", [None, "stranger"])
def test_only_certificates_of_the_authority_are_let_in(
    secure: Any, connect: Connect, own: str | None
) -> None:
    asks = secure.application.storage.settings.tls_client_ca is not None
    with connect(_key(secure), own=own) as client:
        if not asks:
            assert client.capabilities()
            return
        with pytest.raises(ConnectionFailedError, match=r"The connection to .* broke") as refused:
            client.capabilities()
    assert "a certificate of its authority" in refused.value.hint


def test_who_forgets_the_s_is_told(secure: Any) -> None:
    with (
        Client(secure.url.replace("s://", "://"), retries=NO_RETRIES) as client,
        pytest.raises(ConnectionFailedError, match=r"The connection to .* broke") as refused,
    ):
        client.capabilities()
    assert "https://" in refused.value.hint
