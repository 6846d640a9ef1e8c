"""A gateway for tests: the real application, with an engine and runners that compute in this process.

With FVS_TEST_DATABASE=postgresql every gateway has a database of its own on a PostgreSQL server.
"""

import asyncio
import contextlib
import io
import logging
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

import httpx2
import numpy as np
import piexif
import pytest
import structlog
import uvicorn
from computing_runners import ComputingRunners
from fvs_service.application import Storage
from fvs_service.gateway.connection import http_protocol
from fvs_service.logs import configure_logging
from fvs_service.rankings.port import SceneRunners
from fvs_service.serving.rest_app import create_app
from fvs_service.settings import Settings
from gateways import Gateway, Overrides, migrate, running_gateway, settings_for
from lasting_inspectors import share_inspectors
from PIL import Image
from postgresql_server import PostgresqlServer, programs
from shared_postgresql import shared_server

share_inspectors()


@pytest.fixture(scope="session")
def postgresql() -> PostgresqlServer:
    """A PostgreSQL server that all tests share.

    Where its programs are missing, tests skip; in CI (CI=true) they fail.
    """
    if programs() is None:
        missing = "PostgreSQL is not installed (Debian: apt-get install postgresql)"
        if os.environ.get("CI") == "true":
            pytest.fail(missing)
        pytest.skip(missing)
    return shared_server()


@pytest.fixture(scope="session")
def gateway(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Gateway]:
    """The gateway of a single user's machine; all tests share it, each makes scenes of its own."""
    with running_gateway(
        settings_for(tmp_path_factory.mktemp("gateway") / "service", {"webhook_hosts": ("hooks.example",)})
    ) as gateway:
        yield gateway


def _to_captured_stderr(*_: object) -> structlog.PrintLogger:
    return structlog.PrintLogger(io.StringIO() if sys.stderr is sys.__stderr__ else sys.stderr)


@pytest.fixture(autouse=True)
def _plain_logs(pytestconfig: pytest.Config) -> Iterator[None]:
    """Log as the service does, in the tests of the service alone.

    A server in a thread logs the end of a stream when the test that read it has ended: where pytest does not
    capture just then, that line goes nowhere instead of between the dots.
    """
    configure_logging(machine=True)
    if pytestconfig.getoption("capture") != "no":
        structlog.configure(logger_factory=_to_captured_stderr)
    root = logging.getLogger()
    own = tuple(root.handlers)
    yield
    for handler in own:
        root.removeHandler(handler)


@pytest.fixture(scope="session")
def running() -> Callable[[Settings], contextlib.AbstractContextManager[Gateway]]:
    """Run a gateway in a ``with`` block."""
    return running_gateway


@pytest.fixture(scope="session")
def settings_of() -> Callable[[Path, Overrides], Settings]:
    """Settings for tests: quick to start, in a folder, with some of them changed."""
    return settings_for


@pytest.fixture
def open_gateway(tmp_path: Path) -> Iterator[Callable[..., Gateway]]:
    """Open a gateway of one's own, with other settings than the default."""
    with contextlib.ExitStack() as stack:
        yield lambda **overrides: stack.enter_context(
            running_gateway(settings_for(tmp_path / "service", overrides))
        )


class _Server(uvicorn.Server):
    """Looks a hundred times a second, and not ten times, whether it is to end."""

    async def main_loop(self) -> None:
        while not await self.on_tick(0):
            await asyncio.sleep(0.01)


@pytest.fixture
def serve(tmp_path: Path) -> Iterator[Callable[..., Gateway]]:
    """Start a gateway on a free port of loopback, for what needs a real connection."""
    stops: list[Callable[[], None]] = []

    def start(runners: Callable[[Storage], SceneRunners] = ComputingRunners, **overrides: Any) -> Gateway:
        settings = settings_for(tmp_path / "service", overrides)
        migrate(settings)
        app = create_app(settings, runners)
        config = uvicorn.Config(
            app, port=0, log_level="error", timeout_graceful_shutdown=1, http=http_protocol()
        )
        server = _Server(config)
        thread = threading.Thread(target=server.run)
        thread.start()
        while not server.started:
            assert thread.is_alive()
            time.sleep(0.01)
        port = server.servers[0].sockets[0].getsockname()[1]
        client = httpx2.Client(base_url=f"http://127.0.0.1:{port}", timeout=30)

        def stop() -> None:
            client.close()
            server.should_exit = True
            thread.join()

        stops.append(stop)
        return Gateway(app, client, settings)

    yield start
    for stop in stops:
        stop()


@pytest.fixture(scope="session")
def photograph() -> Callable[..., bytes]:
    """Make a photograph: sharp noise of its own per ``seed``, with the EXIF that is asked for."""

    def make(
        seed: int = 0,
        size: tuple[int, int] = (96, 64),
        image_format: str = "JPEG",
        exif: Mapping[str, Any] | None = None,
    ) -> bytes:
        width, height = size
        pixels = np.random.default_rng(seed).integers(0, 256, (height, width, 3), dtype=np.uint8)
        out = io.BytesIO()
        options = {"exif": piexif.dump(dict(exif))} if exif else {}
        Image.fromarray(pixels).save(out, image_format, **options)
        return out.getvalue()

    return make
