"""The service's URL and API key, the options of the HTTP client, and the errors of a failed connection."""

import importlib.metadata
import ipaddress
import os
import platform
import ssl
from dataclasses import dataclass
from typing import Any
from urllib.parse import urlsplit

import httpx2

from fvs_client.errors import AnswerTimeoutError, ConnectionFailedError, FvsError, UnexpectedAnswerError
from fvs_client.request import Request
from fvs_client.service_url import DEFAULT_URL, base_url

_CONNECT_TIMEOUT_S = 10.0
# A refused client does not learn the reason: with TLS 1.3 the connection just ends.
_WITH_TLS = (
    "Try again. If it breaks each time, the service may ask clients for a certificate of its authority: give "
    "one with ssl_context."
)
_WITHOUT_TLS = "Try again. If it breaks each time, the service may have TLS: https://."


@dataclass(frozen=True)
class Connection:
    """How to reach the service."""

    url: str
    api_key: str | None
    timeout_s: float
    ssl_context: ssl.SSLContext | None

    @classmethod
    def resolve(
        cls, url: str | None, api_key: str | None, timeout_s: float, ssl_context: ssl.SSLContext | None
    ) -> "Connection":
        """Take the URL and the key that are None from ``FVS_URL`` and ``FVS_API_KEY``.

        Raises ``ValueError`` for an invalid URL.
        """
        chosen = base_url(url or os.environ.get("FVS_URL"))
        parts = urlsplit(chosen)
        if parts.scheme not in ("http", "https") or not parts.hostname:
            raise ValueError(f"{chosen!r} is not the URL of a service; an example is {DEFAULT_URL}")
        key = api_key or os.environ.get("FVS_API_KEY") or None
        return cls(chosen, key, timeout_s, ssl_context)

    @property
    def options(self) -> dict[str, Any]:
        """Arguments of ``httpx2.Client`` and ``httpx2.AsyncClient``."""
        headers = {"User-Agent": self.user_agent, "Accept": "application/json"}
        if self.api_key is not None:
            headers["Authorization"] = f"Bearer {self.api_key}"
        return {
            "base_url": self.url,
            "headers": headers,
            "timeout": httpx2.Timeout(self.timeout_s, connect=min(_CONNECT_TIMEOUT_S, self.timeout_s)),
            "verify": self._trust,
            "trust_env": not self.loopback,  # a proxy cannot reach this machine's loopback
        }

    @property
    def _trust(self) -> ssl.SSLContext | bool:
        if self.ssl_context is not None:
            return self.ssl_context
        # Honour SSL_CERT_FILE although trust_env is off.
        return ssl.create_default_context() if self.loopback and self.url.startswith("https") else True

    @property
    def user_agent(self) -> str:
        """The client's name and version."""
        version = importlib.metadata.version("fvs-client")
        return f"fvs-client/{version} python/{platform.python_version()}"

    @property
    def loopback(self) -> bool:
        """Whether the service is on this machine."""
        host = urlsplit(self.url).hostname or ""
        try:
            return ipaddress.ip_address(host).is_loopback
        except ValueError:
            return host == "localhost"

    def request_options(self, request: Request) -> dict[str, Any]:
        """Arguments of ``build_request`` except the body of a ``FileBody``."""
        options: dict[str, Any] = {"headers": dict(request.headers), "params": dict(request.params)}
        if isinstance(request.body, bytes):
            options["content"] = request.body
        if request.document is not None:
            options["json"] = request.document
        if request.read_timeout_s is not None:
            options["timeout"] = httpx2.Timeout(
                self.timeout_s, connect=min(_CONNECT_TIMEOUT_S, self.timeout_s), read=request.read_timeout_s
            )
        return options

    def failure(self, error: httpx2.HTTPError, request_id: str | None = None) -> FvsError:
        """The ``FvsError`` for an error of the HTTP client."""
        if isinstance(error, httpx2.ConnectError) and "[SSL" in str(error):
            return ConnectionFailedError(
                f"There is no secure connection to {self.url}: {error}.",
                hint="Set SSL_CERT_FILE to a certificate to trust, or use http:// if the service has no TLS.",
                request_id=request_id,
            )
        if isinstance(error, httpx2.ConnectError | httpx2.ConnectTimeout):
            return ConnectionFailedError(
                f"There is no answer at {self.url}.",
                hint="Is the service running? `fvs serve` starts one; FVS_URL sets where it is.",
                request_id=request_id,
            )
        if isinstance(error, httpx2.TimeoutException):
            return AnswerTimeoutError(
                f"{self.url} did not answer in time.",
                hint="The link or the service is slow: try again, or give the client a longer timeout_s.",
                request_id=request_id,
            )
        if isinstance(error, httpx2.TransportError) and not isinstance(error, httpx2.SSEError):
            return ConnectionFailedError(
                f"The connection to {self.url} broke: {str(error).rstrip('.') or 'no reason known'}.",
                hint=_WITH_TLS if self.url.startswith("https") else _WITHOUT_TLS,
                request_id=request_id,
            )
        return UnexpectedAnswerError(
            f"The answer of {self.url} cannot be read: {error}", request_id=request_id
        )
