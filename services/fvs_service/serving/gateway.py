"""The gateway's servers: sockets, signals."""

import asyncio
import contextlib
import gc
import resource
import socket
import sys
from collections.abc import Callable
from types import FrameType

import structlog
import uvicorn
from fastapi import FastAPI
from pebble import CONSTS

from fvs_service.application import MakeRunners
from fvs_service.errors import UnavailableError
from fvs_service.gateway.addresses import Addresses
from fvs_service.gateway.connection import http_protocol
from fvs_service.gateway.drain import Drain
from fvs_service.gateway.protection import require_protection
from fvs_service.gateway.rpc.calls import Gateway
from fvs_service.serving.rest_app import create_app
from fvs_service.serving.rpc_server import RpcServer
from fvs_service.settings import Settings

_STOP_WITHIN_S = 1
"""What is in progress after ``drain_s`` is abandoned: calls within this time, then requests within it."""
_UNREAD_MS = 120_000
_INSPECTORS_S = 1.0
"""Interval at which pebble checks for dead and overdue inspectors; its default of 0.1 s is a load."""
_SWITCH_S = 0.001
"""How long a thread of a handler may keep the interpreter when the event loop wants it; Python's is 5 ms."""

_OPEN_FILES = 65_536

_log = structlog.get_logger()


def run_gateway(
    settings: Settings,
    make_runners: MakeRunners,
    *,
    announce: Callable[[Addresses], object] = lambda _: None,
    beat: Callable[[], object] = lambda: None,
    beat_every_s: float | None = None,
) -> None:
    """Serve until SIGINT or SIGTERM; calls ``announce`` once requests are served.

    Calls ``beat`` on the event loop every ``beat_every_s``, if given.

    Raises ``ForbiddenError`` when requests need an API key and there is no valid one.
    """
    require_protection(settings)
    _allow_many_connections()
    sys.setswitchinterval(_SWITCH_S)
    CONSTS.sleep_unit = _INSPECTORS_S
    app = create_app(settings, make_runners)
    config = uvicorn.Config(
        app,
        host=settings.host,
        port=settings.port,
        loop="asyncio",  # the protocol sets how much asyncio's transports read at once; uvloop's cannot
        http=http_protocol(),
        ws="none",
        log_config=None,  # see ``fvs_service.logs``
        access_log=False,
        proxy_headers=False,  # nothing depends on the client's address
        server_header=False,
        date_header=False,  # see ``RequestContext``
        timeout_keep_alive=30,
        timeout_graceful_shutdown=_STOP_WITHIN_S,
    )
    listening = listen(config)
    host, port = listening.getsockname()[:2]
    url = f"http://{f'[{host}]' if ':' in host else host}:{port}"
    server = GatewayServer(
        config,
        app,
        settings,
        started=lambda rpc: announce(Addresses(url=url, rpc_port=rpc)),
        beat=beat,
        beat_every_s=beat_every_s,
    )
    server.run(sockets=[listening])


def _allow_many_connections() -> None:
    """Raise the limit of open files: many systems allow a process 1,024, and each connection is one."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _OPEN_FILES if hard == resource.RLIM_INFINITY else min(hard, _OPEN_FILES)
    if 0 <= soft < most:
        resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))


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


class GatewayServer(uvicorn.Server):
    """Serves REST and, unless the settings turn it off, gRPC on one event loop.

    Calls ``started`` with the port of gRPC, None without it, once it serves requests; then ``beat`` every
    ``beat_every_s``, if given.
    """

    def __init__(
        self,
        config: uvicorn.Config,
        app: FastAPI,
        settings: Settings,
        started: Callable[[int | None], object] = lambda _: None,
        beat: Callable[[], object] = lambda: None,
        beat_every_s: float | None = None,
    ) -> None:
        super().__init__(config)
        self._beat, self._beat_every_s = beat, beat_every_s
        self._app, self._settings, self._when_started = app, settings, started
        self._rpc: RpcServer | None = None
        self._signaled = asyncio.Event()
        self._wake: Callable[[], object] = lambda: None

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Open the application, listen, and call ``started``."""
        await super().startup(sockets)
        # What is loaded now stays. A full collection would look at all of it, and take 0.1 s each time.
        gc.collect()
        gc.freeze()
        if not self.started:
            return
        if self._settings.rpc_port is None:
            self._when_started(None)
            return
        gateway = Gateway.of(self._app.state, self._settings.upload_idle_s)
        rpc = RpcServer(gateway, self._settings)
        try:
            self._when_started(await rpc.start())
        except UnavailableError as error:
            _log.error(error.message, hint=error.hint)
            await self.shutdown(sockets)
            self.should_exit = True
            return
        self._rpc = rpc

    async def main_loop(self) -> None:
        """Wait for a signal; uvicorn looks for one, and at the clock, ten times a second."""
        loop = asyncio.get_running_loop()
        self._wake = lambda: loop.call_soon_threadsafe(self._signaled.set)
        while not await self.on_tick(0):
            self._beat()
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(self._signaled.wait(), self._beat_every_s)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """End ``main_loop``."""
        super().handle_exit(sig, frame)
        self._wake()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """End the streams of events, which never end by themselves; other requests may finish.

        Meanwhile the gateway answers probes: it is not ready.
        """
        drain: Drain = self._app.state.drain
        drain.begin()
        await self._app.state.feed.close()
        await drain.ended(self._settings.drain_s)
        if self._rpc is not None:  # before the application closes
            await self._rpc.stop(_STOP_WITHIN_S)
        await super().shutdown(sockets)
