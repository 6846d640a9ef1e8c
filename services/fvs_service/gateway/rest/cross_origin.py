"""CORS (in the Fetch standard): pages of allowed origins may use the service."""

from collections.abc import Sequence

from starlette.datastructures import Headers
from starlette.middleware.cors import CORSMiddleware
from starlette.types import ASGIApp, Receive, Scope, Send

_EVERY = ("*",)


class CrossOrigin(CORSMiddleware):
    """Answers preflights of ``origins``, and lets their pages read every response, errors included.

    Keys come in the Authorization header, which a page must have; the browser adds nothing by itself (no
    credentials), so all methods and headers may be allowed, and all headers exposed. Requests of other
    origins are left to ``OriginGuard``.
    """

    def __init__(self, app: ASGIApp, origins: Sequence[str]) -> None:
        super().__init__(
            app,
            allow_origins=origins,
            allow_methods=_EVERY,
            allow_headers=_EVERY,
            allow_private_network=True,
            expose_headers=_EVERY,
        )

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        foreign = scope["type"] == "http" and not self.is_allowed_origin(
            Headers(scope=scope).get("origin", "")
        )
        if foreign and scope["method"] == "OPTIONS":
            await self.app(scope, receive, send)
            return
        await super().__call__(scope, receive, send)
