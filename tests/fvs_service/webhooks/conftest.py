"""A receiver of webhooks, which the gateway sends to."""

import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import orjson
import pytest
from conftest_of import conftest_of
from fvs_service.settings import Settings
from fvs_service.webhooks import repository
from gateways import running_gateway, settings_for

_service = conftest_of("fvs_service")
photograph = _service.photograph
_plain_logs = _service._plain_logs

_WITHIN_S = 20


@dataclass
class Receiver:
    """An HTTP server that records what it receives, and answers with ``status``."""

    url: str
    received: list[tuple[dict[str, str], bytes]] = field(default_factory=list)
    status: int = 204
    more: dict[str, str] = field(default_factory=dict)

    @property
    def kinds(self) -> list[str]:
        """The kinds of the received events, in order."""
        return [orjson.loads(body)["kind"] for _, body in self.received]

    def wait(self, until: Callable[[], bool]) -> None:
        """Wait until a condition holds."""
        deadline = time.monotonic() + _WITHIN_S
        while not until():
            assert time.monotonic() < deadline, self.kinds
            time.sleep(0.01)


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    """See ``Receiver``."""

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["content-length"]))
            found.received.append(({name.lower(): value for name, value in self.headers.items()}, body))
            self.send_response(found.status)
            for name, value in found.more.items():
                self.send_header(name, value)
            self.end_headers()

        def do_GET(self) -> None:  # of a redirect
            found.received.append(({"webhook-id": "redirected"}, b""))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        found = Receiver(f"http://127.0.0.1:{server.server_port}/hook?a=b")
        thread = threading.Thread(target=server.serve_forever, args=(0.02,))
        thread.start()
        yield found
        server.shutdown()
        thread.join()


@pytest.fixture(autouse=True)
def _no_pauses(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repository, "FIRST_PAUSE_S", 0.02)
    monkeypatch.setattr(repository, "LONGEST_PAUSE_S", 0.02)


@pytest.fixture
def settings(tmp_path: Path) -> Settings:
    """Those of a service that may send webhooks to this machine."""
    return settings_for(tmp_path / "service", {"webhook_hosts": ("127.0.0.1",)})


@pytest.fixture
def gateway(settings: Settings) -> Iterator[Any]:
    """Its gateway."""
    with running_gateway(settings) as gateway:
        yield gateway
