"""The gateway's HTTP server: socket, TLS, and the rule that remote access needs keys."""

import asyncio
import gc
import socket
import ssl
import sys
from collections.abc import Awaitable, Callable
from types import FrameType

import uvicorn
from pebble import CONSTS

from fvs_service.application import MakeRunners, open_storage
from fvs_service.errors import ForbiddenError
from fvs_service.gateway.connection import http_protocol
from fvs_service.gateway.rest.app import create_app
from fvs_service.settings import Settings

_STOP_WITHIN_S = 1
"""Requests that take longer are given up; the supervisor's patience is longer than this."""
_UNREAD_MS = 120_000
_INSPECTORS_S = 1.0
"""How often pebble looks whether an inspector has died or takes too long; its 0.1 s is a load by itself."""
_SWITCH_S = 0.001
"""How long a thread of a handler may keep the interpreter when the event loop wants it; Python's is 5 ms."""


def run_gateway(
    settings: Settings, make_runners: MakeRunners, *, announce: Callable[[str], object] = lambda _: None
) -> None:
    """Serve until SIGINT or SIGTERM; calls ``announce`` with the URL once requests are served.

    Raises ``ForbiddenError`` when other machines can reach the service and there is no API key.
    """
    require_protection(settings)
    sys.setswitchinterval(_SWITCH_S)
    CONSTS.sleep_unit = _INSPECTORS_S
    app = create_app(settings, make_runners)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        http=http_protocol(settings.upload_idle_s, read_within_s=settings.read_within_s),
        ws="none",
        log_config=None,  # see ``fvs_service.logs``
        access_log=False,
        server_header=False,
        date_header=False,  # see ``RequestContext``
        timeout_keep_alive=30,
        timeout_graceful_shutdown=_STOP_WITHIN_S,
        ssl_certfile=settings.tls_certificate,
        ssl_keyfile=settings.tls_key,
        ssl_ca_certs=None if settings.tls_client_ca is None else str(settings.tls_client_ca),
        ssl_cert_reqs=ssl.CERT_NONE if settings.tls_client_ca is None else ssl.CERT_REQUIRED,
    )
    listening = listen(config)
    host, port = listening.getsockname()[:2]
    scheme = "http" if settings.tls_certificate is None else "https"
    url = f"{scheme}://{f'[{host}]' if ':' in host else host}:{port}"
    _Server(config, lambda: announce(url), lambda: app.state.feed.close()).run(sockets=[listening])


def listen(config: uvicorn.Config) -> socket.socket:
    """The socket that the gateway listens on, without Nagle's algorithm.

    asyncio disables it only on sockets made with the protocol TCP, and uvicorn's has none: most responses
    would wait 40 ms for the client's acknowledgement of their first part.
    """
    listening = config.bind_socket()
    # Connections inherit these options.
    listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
    if hasattr(socket, "TCP_USER_TIMEOUT"):  # a client that reads nothing more does not keep its connection
        listening.setsockopt(socket.IPPROTO_TCP, socket.TCP_USER_TIMEOUT, _UNREAD_MS)
    return listening


class _Server(uvicorn.Server):
    """Calls ``started`` once it serves requests, and ``end_streams`` when it stops to."""

    def __init__(
        self,
        config: uvicorn.Config,
        started: Callable[[], object],
        end_streams: Callable[[], Awaitable[None]],
    ) -> None:
        super().__init__(config)
        self._started, self._end_streams = started, end_streams
        self._signaled = asyncio.Event()
        self._wake: Callable[[], object] = lambda: None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open the application, listen, and call ``started``."""
        await super().startup(sockets)
        # What is loaded now stays. A full collection would look at all of it, and take 0.1 s each time.
        gc.collect()
        gc.freeze()
        if self.started:
            self._started()

    async def main_loop(self) -> None:
        """Wait for a signal; uvicorn looks for one, and at the clock, ten times a second."""
        loop = asyncio.get_running_loop()
        self._wake = lambda: loop.call_soon_threadsafe(self._signaled.set)
        while not await self.on_tick(0):
            await self._signaled.wait()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End ``main_loop``."""
        super().handle_exit(sig, frame)
        self._wake()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams of events, which would have no end of their own, and all other requests."""
        await self._end_streams()
        await super().shutdown(sockets)


def require_protection(settings: Settings) -> None:
    """Raise ``ForbiddenError`` when keys are required and there is none."""
    if not settings.keys_required:
        return
    with open_storage(settings) as storage:
        if any(key.valid for key in storage.keys.all()):
            return
    if settings.loopback:
        raise ForbiddenError(
            "FVS_REQUIRE_KEYS is set, and there is no API key.",
            hint="Create one first: fvs keys create NAME.",
        )
    raise ForbiddenError(
        f"Programs on other machines can reach {settings.host}, and there is no API key.",
        hint="Create one first: fvs keys create NAME. Or listen on 127.0.0.1.",
    )
