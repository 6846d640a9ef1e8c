# Generated from _async/client.py by `make generate`. Do not edit.
"""The client of a service, with its resources."""

import ssl
from types import TracebackType
from typing import Self

import httpx2

from fvs_client import requests
from fvs_client._sync.jobs import Jobs
from fvs_client._sync.plans import Plans
from fvs_client._sync.rankings import Rankings
from fvs_client._sync.scenes import Scenes
from fvs_client._sync.session import Session
from fvs_client._sync.snapshots import Snapshots
from fvs_client._sync.webhooks import Webhooks
from fvs_client.connection import Connection
from fvs_client.retries import Retries
from fvs_schema.service import Capabilities, Health


class Client:
    """Connection to an fvs service, with its resources as attributes.

    ``Client`` blocks and may be shared by threads; ``AsyncClient`` has the same methods for ``await``.
    ``url`` and ``api_key`` default to ``FVS_URL`` and ``FVS_API_KEY``, and the URL then to
    ``http://127.0.0.1:8000``. ``ssl_context`` is for certificates of your own; ``transport`` replaces the
    network in tests. Raises ``ValueError`` for an invalid URL.
    """

    def __init__(
        self,
        url: str | None = None,
        api_key: str | None = None,
        *,
        timeout_s: float = 60.0,
        retries: Retries | None = None,
        ssl_context: ssl.SSLContext | None = None,
        transport: httpx2.BaseTransport | None = None,
    ) -> None:
        connection = Connection.resolve(url, api_key, timeout_s, ssl_context)
        self.url = connection.url
        self._session = Session(connection, retries or Retries(), transport)
        self.scenes = Scenes(self._session)
        self.jobs = Jobs(self._session)
        self.snapshots = Snapshots(self._session)
        self.rankings = Rankings(self._session)
        self.plans = Plans(self._session)
        self.webhooks = Webhooks(self._session)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.url!r})"

    def capabilities(self) -> Capabilities:
        """Get the service's capabilities and limits."""
        return self._session.fetch(Capabilities, requests.capabilities())

    def health(self) -> Health:
        """Check that the service is ready; raises ``FvsError`` when it is not."""
        return self._session.fetch(Health, requests.health())

    def close(self) -> None:
        """Close the connections."""
        self._session.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()
