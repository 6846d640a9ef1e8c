"""Protection from web pages: a browser on this machine must not lend them its access.

Where no key is needed, whatever can make a browser send a request can use the service. Two things can: a
page whose name resolves to a loopback address (DNS rebinding; its ``Host`` is wrong), and a page of another
origin, which may send simple requests such as forms (its ``Origin`` or ``Sec-Fetch-Site`` is foreign). Every
browser sends one of these two headers with a request that changes anything; other programs send neither, and
need not. JSON bodies need ``application/json`` besides, which no simple request can have.
"""

from starlette.requests import Request
from starlette.types import ASGIApp, Receive, Scope, Send

from fvs_service.errors import ForeignOriginError, ServiceError, UnknownHostError
from fvs_service.gateway.rest.problems import problem_response
from fvs_service.host_names import host_of, is_loopback
from fvs_service.settings import Settings

_OWN_SITES = ("same-origin", "none")
"""``none``: the user typed the address."""


class OriginGuard:
    """Refuses requests to a name that is not the service's, and requests from pages of other origins."""

    def __init__(self, app: ASGIApp, settings: Settings) -> None:
        self._app = app
        self._hosts = frozenset(map(host_of, settings.allowed_hosts))
        self._origins = frozenset(settings.allowed_origins)
        self._any_host = settings.keys_required is True and not settings.allowed_hosts

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Handle one request."""
        if scope["type"] == "http":
            request = Request(scope)
            refused = self._wrong_host(request) or self._foreign(request)
            if refused is not None:
                await problem_response(request, refused)(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _wrong_host(self, request: Request) -> ServiceError | None:
        if self._any_host:
            return None
        for name in request.headers.getlist("host"):
            host = host_of(name)
            if host not in self._hosts and not is_loopback(host):
                return UnknownHostError(
                    f"{name[:100]} is not a name of this service.",
                    hint="The operator can add it to FVS_ALLOWED_HOSTS.",
                )
        return None

    def _foreign(self, request: Request) -> ServiceError | None:
        headers = request.headers
        origin = headers.get("origin")
        if origin is not None:
            own = origin.partition("://")[2].lower() == headers.get("host", "").lower() != ""
            foreign = not own and origin.lower() not in self._origins
        elif headers.get("sec-fetch-mode") == "navigate" and request.method in ("GET", "HEAD"):
            foreign = False  # a link that the user followed; the page that has it cannot read the response
        else:
            foreign = headers.get("sec-fetch-site", "none") not in _OWN_SITES
        if not foreign:
            return None
        return ForeignOriginError(
            f"Pages of {(origin or 'another origin')[:100]} may not use this service.",
            hint="The operator can add their origin to FVS_ALLOWED_ORIGINS.",
        )
