"""The service that clients are tested against: a gateway on a socket of loopback."""

import signal
import threading
import time
from collections.abc import Callable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import httpx2
import pytest
import uvicorn
from computing_runners import ComputingRunners
from conftest_of import conftest_of
from fvs_client import Client, Retries
from fvs_client.cli.app import app as program
from fvs_service.serving.gateway import GatewayServer
from fvs_service.serving.rest_app import create_app
from gateways import Gateway, settings_for
from typer.testing import CliRunner, Result

_service = conftest_of("fvs_service")
serve = _service.serve
photograph = _service.photograph
_plain_logs = _service._plain_logs


@pytest.fixture(scope="session")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Any]:
    """A running gateway whose worker the tests play; all share it, each makes scenes of its own."""
    overrides = {"event_heartbeat_s": 0.2, "grpc": False, "webhook_hosts": ("hooks.example",)}
    settings = settings_for(tmp_path_factory.mktemp("clients") / "service", overrides)
    app = create_app(settings, ComputingRunners)
    ports: list[int | None] = []
    config = uvicorn.Config(app, port=0, log_level="error", timeout_graceful_shutdown=1)
    server = GatewayServer(config, app, settings, ports.append)
    thread = threading.Thread(target=server.run)
    thread.start()
    while not ports:
        assert thread.is_alive()
        time.sleep(0.01)
    port = server.servers[0].sockets[0].getsockname()[1]
    with httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=30) as plain:
        yield Gateway(app, plain, settings)
    server.handle_exit(signal.SIGTERM, None)
    thread.join()


@pytest.fixture
def url(gateway: Any) -> str:
    """Where it is."""
    return str(gateway.client.base_url).rstrip("/")


@pytest.fixture
def client(url: str) -> Iterator[Client]:
    """A client of the gateway."""
    with Client(url, retries=Retries(first_s=0.01, longest_s=0.05)) as client:
        yield client


@pytest.fixture
def scene_id(client: Client) -> str:
    """A scene without images."""
    return client.scenes.create("quarry").id


@pytest.fixture
def run(url: str, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Result]:
    """Runs `fvs-client` with these words, and checks its exit status."""
    monkeypatch.setenv("FVS_URL", url)
    monkeypatch.delenv("FVS_API_KEY", raising=False)
    monkeypatch.setenv("COLUMNS", "160")

    def run(*words: str | Path, expect: int = 0) -> Result:
        result = CliRunner().invoke(program, [str(word) for word in words])
        assert result.exit_code == expect, result.output
        return result

    return run


@pytest.fixture
def photographs(tmp_path: Path, photograph: Callable[..., bytes]) -> Path:
    """A folder with three photographs, one of them in a folder below, and other files."""
    folder = tmp_path / "photographs"
    (folder / "left").mkdir(parents=True)
    (folder / ".cache").mkdir()
    (folder / "b.jpg").write_bytes(photograph(1))
    (folder / "a.JPG").write_bytes(photograph(2))
    (folder / "left" / "c.png").write_bytes(photograph(3, image_format="PNG"))
    (folder / "notes.txt").write_text("no photograph")
    (folder / ".cache" / "d.jpg").write_bytes(photograph(4))
    return folder


class Script:
    """A server that misbehaves as it is told: each request takes the next act, the last one stays."""

    def __init__(self, server: ThreadingHTTPServer) -> None:
        self._server = server
        self.acts: list[Callable[[BaseHTTPRequestHandler], None]] = []
        self.requests: list[tuple[str, str, dict[str, str], bytes]] = []
        self._lock = threading.Lock()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self._server.server_port}"

    def play(self, handler: BaseHTTPRequestHandler) -> None:
        length = int(handler.headers.get("Content-Length") or 0)
        body = handler.rfile.read(length)
        headers = {name.lower(): value for name, value in handler.headers.items()}
        with self._lock:
            self.requests.append((handler.command, handler.path, headers, body))
            act = self.acts.pop(0) if len(self.acts) > 1 else self.acts[0]
        act(handler)


@pytest.fixture
def script() -> Iterator[Script]:
    """A misbehaving server."""

    class Handler(BaseHTTPRequestHandler):
        protocol_version = "HTTP/1.1"

        def _play(self) -> None:
            script.play(self)

        do_GET = do_PUT = do_POST = _play  # noqa: N815

        def log_message(self, *_: object) -> None:
            pass

    server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
    server.daemon_threads = True
    script = Script(server)
    thread = threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.02})
    thread.start()
    yield script
    server.shutdown()
    thread.join()
    server.server_close()
