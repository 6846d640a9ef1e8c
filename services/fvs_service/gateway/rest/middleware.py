"""Middleware of all requests: an id, a log line, metrics."""

import asyncio
import time
from contextlib import AbstractContextManager, nullcontext
from email.utils import formatdate
from http import HTTPStatus

import structlog
from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fvs_service.errors import stopping
from fvs_service.gateway.drain import Drain
from fvs_service.gateway.log_fields import about, cause
from fvs_service.gateway.loop_lag import LoopLag
from fvs_service.gateway.request_id import request_id_of
from fvs_service.gateway.rest.problems import defect_response, problem_response
from fvs_service.telemetry import Metrics
from fvs_service.tracing import Span, Tracing

_QUIET = frozenset({"/livez", "/readyz", "/metrics"})

_log = structlog.get_logger()


class RequestContext:
    """Gives every request an id (its ``X-Request-Id`` if that is valid), logs it and counts it.

    Refuses new ones, but for probes, while the gateway stops.
    """

    def __init__(
        self, app: ASGIApp, metrics: Metrics, loop_lag: LoopLag, tracing: Tracing, drain: Drain
    ) -> None:
        self._app = app
        self._metrics = metrics
        self._loop_lag = loop_lag
        self._tracing = tracing
        self._drain = drain

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        offered = dict(scope["headers"]).get(b"x-request-id", b"").decode("latin-1")
        request_id = request_id_of(offered)
        scope.setdefault("state", {})["request_id"] = request_id
        self._loop_lag.handling()
        started, status = time.perf_counter(), HTTPStatus.INTERNAL_SERVER_ERROR.value
        responding = False

        async def send_with_id(message: Message) -> None:
            nonlocal status, responding
            self._loop_lag.handling()
            if message["type"] == "http.response.start":
                status, responding = int(message["status"]), True
                given = {name.lower() for name, _ in message["headers"]}
                ours = (header for header in _headers(request_id) if header[0] not in given)
                message = {**message, "headers": [*message["headers"], *ours]}
            await send(message)

        async def receive_observed() -> Message:
            message = await receive()
            self._loop_lag.handling()
            return message

        with structlog.contextvars.bound_contextvars(request_id=request_id), self._span(scope) as span:
            try:
                if scope["path"] in _QUIET:
                    await self._app(scope, receive_observed, send_with_id)
                elif self._drain.begun:
                    await problem_response(Request(scope), stopping())(scope, receive, send_with_id)
                else:
                    with self._drain.request():
                        await self._app(scope, receive_observed, send_with_id)
            except asyncio.CancelledError:  # the server stops, and this request took longer than it waits
                if not responding:
                    await problem_response(Request(scope), stopping())(scope, receive, send_with_id)
            except Exception as error:
                if responding:
                    raise  # the server cuts the connection
                await defect_response(Request(scope), error)(scope, receive, send_with_id)
            finally:
                seconds = time.perf_counter() - started
                route = getattr(scope.get("route"), "path_format", "unknown")
                self._metrics.requests.labels(scope["method"], route, status).inc()
                self._metrics.seconds.labels(scope["method"], route).observe(seconds)
                span.name(f"{scope['method']} {route}")
                span.add(
                    {"http.route": route, "http.response.status_code": status, "fvs.request_id": request_id}
                )
                if status >= HTTPStatus.INTERNAL_SERVER_ERROR:
                    span.fail(str(status))
                if scope["path"] not in _QUIET:
                    _log.info(
                        "request",
                        method=scope["method"],
                        path=scope["path"],
                        status=status,
                        ms=round(seconds * 1000, 1),
                        **about(scope.get("path_params", {})),
                        **cause(status, scope["state"].get("error")),
                    )

    def _span(self, scope: Scope) -> AbstractContextManager[Span]:
        if scope["path"] in _QUIET:
            return nullcontext(Span())
        offered = dict(scope["headers"]).get(b"traceparent")
        return self._tracing.span(
            scope["method"],
            {"http.request.method": scope["method"], "url.path": scope["path"]},
            kind="SERVER",
            parent=None if offered is None else offered.decode("latin-1"),
            expected=(Exception,),
        )


def _headers(request_id: str) -> list[tuple[bytes, bytes]]:
    return [
        (b"date", formatdate(usegmt=True).encode()),
        (b"x-request-id", request_id.encode("latin-1")),
        (b"x-content-type-options", b"nosniff"),
        (b"cache-control", b"private, no-cache"),
        (b"cross-origin-resource-policy", b"same-origin"),
    ]
