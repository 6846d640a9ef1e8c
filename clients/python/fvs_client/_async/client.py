"""The client of a service, with its resources."""

import ssl
from types import TracebackType
from typing import Self

import httpx2

from fvs_client import requests
from fvs_client._async.jobs import AsyncJobs
from fvs_client._async.plans import AsyncPlans
from fvs_client._async.rankings import AsyncRankings
from fvs_client._async.scenes import AsyncScenes
from fvs_client._async.session import AsyncSession
from fvs_client._async.snapshots import AsyncSnapshots
from fvs_client._async.webhooks import AsyncWebhooks
from fvs_client.connection import Connection
from fvs_client.retries import Retries
from fvs_schema.service import Capabilities, Health


class AsyncClient:
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
        transport: httpx2.AsyncBaseTransport | None = None,
    ) -> None:
        connection = Connection.resolve(url, api_key, timeout_s, ssl_context)
        self.url = connection.url
        self._session = AsyncSession(connection, retries or Retries(), transport)
        self.scenes = AsyncScenes(self._session)
        self.jobs = AsyncJobs(self._session)
        self.snapshots = AsyncSnapshots(self._session)
        self.rankings = AsyncRankings(self._session)
        self.plans = AsyncPlans(self._session)
        self.webhooks = AsyncWebhooks(self._session)

    def __repr__(self) -> str:
        return f"{type(self).__name__}({self.url!r})"

    async def capabilities(self) -> Capabilities:
        """Get the service's capabilities and limits."""
        return await self._session.fetch(Capabilities, requests.capabilities())

    async def health(self) -> Health:
        """Check that the service is ready; raises ``FvsError`` when it is not."""
        return await self._session.fetch(Health, requests.health())

    async def close(self) -> None:
        """Close the connections."""
        await self._session.close()

    async def __aenter__(self) -> Self:
        return self

    async def __aexit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        await self.close()
