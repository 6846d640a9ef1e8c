"""Limits on requests before they are handled: the size and the speed of the body, the fields of the query."""

import asyncio
from collections.abc import Callable

from starlette.requests import Request
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from fvs_service.errors import InvalidRequestError, UnsupportedMediaTypeError
from fvs_service.gateway.rest.problems import problem_response
from fvs_service.gateway.upload_pace import UploadPace
from fvs_service.images.rest_tus import is_upload
from fvs_service.images.upload_files import too_large
from fvs_service.settings import Settings
from fvs_service.telemetry import Metrics

_MAX_QUERY_FIELDS = 64
_WITH_LISTS = ("/rankings", "/plans", "/forecasts", "/missions", "/images:check", "/control-points")
_WITHOUT_LISTS_BYTES = 65_536
"""Maximum size of JSON bodies on all other paths."""


class BodyGuard:
    """Refuses endless queries, and bodies that are too large, encoded, too slow, or stop arriving."""

    def __init__(self, app: ASGIApp, settings: Settings, metrics: Metrics) -> None:
        self._app = app
        self._settings = settings
        self._metrics = metrics

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        if scope["query_string"].count(b"&") >= _MAX_QUERY_FIELDS:
            refused = InvalidRequestError(
                f"The query has more than {_MAX_QUERY_FIELDS} fields.", hint="Send each field once."
            )
            await problem_response(Request(scope), refused)(scope, receive, send)
            return
        pace = UploadPace(self._settings)
        scope.setdefault("state", {})["pace"] = pace
        await self._app(scope, self._guarded(scope, receive, pace), send)

    def _guarded(
        self, scope: Scope, receive: Receive, pace: UploadPace
    ) -> Callable[[], asyncio.Future[Message]]:
        limit = self._limit(scope["path"], scope["method"])
        more = True

        async def guarded() -> Message:
            nonlocal more
            if not more:  # after the body only a disconnect can follow
                return await receive()
            if not pace.received_bytes:  # once the caller is known, who then counts
                _require_readable(scope, limit)
            message = await pace.wait(receive, _body_bytes)
            self._metrics.received_bytes.inc(_body_bytes(message))
            more = message["type"] == "http.request" and message.get("more_body", False)
            if pace.received_bytes > limit:
                raise too_large(limit)
            return message

        return guarded  # type: ignore[return-value]

    def _limit(self, path: str, method: str) -> int:
        limits = self._settings.limits
        if (method == "PUT" and "/images/" in path) or (method in ("POST", "PATCH") and is_upload(path)):
            return max(limits.image_bytes, limits.video_bytes)  # what it is, its name tells later
        if method == "POST" and path.endswith("/images"):
            return limits.multipart_bytes
        if path.endswith(_WITH_LISTS):
            return limits.json_bytes
        return min(limits.json_bytes, _WITHOUT_LISTS_BYTES)


def _body_bytes(message: Message) -> int:
    return len(message.get("body", b""))


def _require_readable(scope: Scope, limit: int) -> None:
    """Raise the error for a body that is declared too large or encoded."""
    headers = dict(scope["headers"])
    declared = headers.get(b"content-length", b"")
    if declared.isdigit() and (len(declared) > 18 or int(declared) > limit):
        raise too_large(limit)
    encoding = headers.get(b"content-encoding", b"identity").decode("latin-1").strip().lower()
    if encoding not in ("", "identity"):
        raise UnsupportedMediaTypeError(
            f"The body has the encoding {encoding[:100]}.", hint="Send it without a Content-Encoding."
        )
