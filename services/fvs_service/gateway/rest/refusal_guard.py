"""Answers requests of keys that are wrong or on hold before their body is read; counts refused requests."""

from starlette.datastructures import Headers
from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from fvs_service.auth import bearer_key
from fvs_service.errors import ServiceError
from fvs_service.gateway.refusals import Refusals
from fvs_service.gateway.rest.bodies import has_body
from fvs_service.gateway.rest.problems import problem_response

_WITH_KEY = "/v1/"


class RefusalGuard:
    """Applies ``Refusals`` to the requests of API keys."""

    def __init__(self, app: ASGIApp, refusals: Refusals) -> None:
        self._app, self._refusals = app, refusals

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        headers = Headers(scope=scope) if scope["type"] == "http" else Headers()
        key = bearer_key(headers.get("authorization", ""))
        if key is None or not scope["path"].startswith(_WITH_KEY):  # others, such as probes, need none
            await self._app(scope, receive, send)
            return
        try:
            self._refusals.check(key, with_body=has_body(headers))
        except ServiceError as error:
            await problem_response(Request(scope), error)(scope, receive, send)
            return
        await self._app(scope, receive, send)
        if "error" in scope["state"]:
            self._refusals.count(key, scope["state"].get("principal"), scope["state"]["error"])
