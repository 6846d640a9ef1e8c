"""Answers requests of keys that are on hold before their body is read, and counts those that are refused."""

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from fvs_service.auth import bearer_key
from fvs_service.errors import LimitExceededError
from fvs_service.gateway.refusals import Refusals
from fvs_service.gateway.rest.problems import problem_response


class RefusalGuard:
    """Applies ``Refusals`` to the requests of API keys."""

    def __init__(self, app: ASGIApp, refusals: Refusals) -> None:
        self._app, self._refusals = app, refusals

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        headers = Headers(scope=scope) if scope["type"] == "http" else Headers()
        key = bearer_key(headers.get("authorization", ""))
        if key is None:
            await self._app(scope, receive, send)
            return
        if _has_body(headers):
            try:
                self._refusals.require_no_hold(key)
            except LimitExceededError as error:
                await problem_response(Request(scope), error)(scope, receive, send)
                return
        await self._app(scope, receive, send)
        state = scope["state"]
        if "error" in state and "principal" in state:
            self._refusals.count(key, state["principal"], state["error"])


def _has_body(headers: Headers) -> bool:
    return headers.get("content-length", "0") != "0" or "transfer-encoding" in headers
