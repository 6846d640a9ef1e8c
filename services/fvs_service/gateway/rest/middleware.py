"""Middleware of all requests: an id, limits on the body's size and time, a log line, metrics."""

import asyncio
import re
import time
from collections.abc import Callable
from http import HTTPStatus

import structlog
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fvs_service.errors import SlowRequestError
from fvs_service.gateway.rest.problems import problem_response
from fvs_service.ids import new_id
from fvs_service.images.staging import too_large
from fvs_service.settings import Settings
from fvs_service.telemetry import Metrics

_REQUEST_ID = re.compile(r"^[A-Za-z0-9._-]{1,64}$")
_QUIET = frozenset({"/livez", "/readyz", "/metrics"})

_log = structlog.get_logger()


class RequestContext:
    """Gives every request an id (its ``X-Request-Id`` if that is valid), logs it and counts it."""

    def __init__(self, app: ASGIApp, metrics: Metrics) -> None:
        self._app = app
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        offered = dict(scope["headers"]).get(b"x-request-id", b"").decode("latin-1")
        request_id = offered if _REQUEST_ID.match(offered) else new_id("req")
        scope.setdefault("state", {})["request_id"] = request_id
        started, status = time.perf_counter(), HTTPStatus.INTERNAL_SERVER_ERROR.value

        async def send_with_id(message: Message) -> None:
            nonlocal status
            if message["type"] == "http.response.start":
                status = message["status"]
                message = {**message, "headers": [*message["headers"], *_headers(request_id)]}
            await send(message)

        with structlog.contextvars.bound_contextvars(request_id=request_id):
            try:
                await self._app(scope, receive, send_with_id)
            finally:
                seconds = time.perf_counter() - started
                route = getattr(scope.get("route"), "path", "unknown")
                self._metrics.requests.labels(scope["method"], route, status).inc()
                self._metrics.seconds.labels(scope["method"], route).observe(seconds)
                if scope["path"] not in _QUIET:
                    _log.info(
                        "request",
                        method=scope["method"],
                        path=scope["path"],
                        status=status,
                        ms=round(seconds * 1000, 1),
                    )


class BodyGuard:
    """Rejects requests whose body is larger than the route's limit, or stops arriving."""

    def __init__(self, app: ASGIApp, settings: Settings, metrics: Metrics) -> None:
        self._app = app
        self._idle_s = settings.upload_idle_s
        self._limits = settings.limits
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        limit = self._limit(scope["path"], scope["method"])
        declared = dict(scope["headers"]).get(b"content-length", b"")
        if declared.isdigit() and int(declared) > limit:
            await problem_response(Request(scope), too_large(limit))(scope, receive, send)
            return
        await self._app(scope, self._guarded(receive, limit), send)

    def _guarded(self, receive: Receive, limit: int) -> Callable[[], asyncio.Future[Message]]:
        received, more = 0, True

        async def guarded() -> Message:
            nonlocal received, more
            if not more:  # after the body only a disconnect can follow
                return await receive()
            try:
                async with asyncio.timeout(self._idle_s):
                    message = await receive()
            except TimeoutError as error:
                raise SlowRequestError(f"No byte of the body arrived for {self._idle_s:g} s.") from error
            received += len(message.get("body", b""))
            self._metrics.received_bytes.inc(len(message.get("body", b"")))
            more = message["type"] == "http.request" and message.get("more_body", False)
            if received > limit:
                raise too_large(limit)
            return message

        return guarded  # type: ignore[return-value]

    def _limit(self, path: str, method: str) -> int:
        if method == "PUT" and "/images/" in path:
            return self._limits.image_bytes
        if method == "POST" and path.endswith("/images"):
            return self._limits.multipart_bytes
        return self._limits.json_bytes


def _headers(request_id: str) -> list[tuple[bytes, bytes]]:
    return [
        (b"x-request-id", request_id.encode("latin-1")),
        (b"x-content-type-options", b"nosniff"),
        (b"cache-control", b"private, no-cache"),
    ]
