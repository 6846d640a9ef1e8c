"""The middleware of all requests."""

import asyncio
import json
from datetime import UTC, datetime
from email.utils import parsedate_to_datetime
from typing import Any

from fvs_service.gateway.drain import Drain
from fvs_service.gateway.loop_lag import LoopLag
from fvs_service.gateway.rest.middleware import RequestContext
from fvs_service.telemetry import Metrics
from fvs_service.tracing import Tracing
from starlette.types import Message, Receive, Scope, Send


def test_a_request_that_is_cut_when_the_service_stops_is_told_to_come_again() -> None:
    sent: list[Message] = []

    async def endless(_scope: Scope, _receive: Receive, _send: Send) -> None:
        await asyncio.Event().wait()

    async def receive() -> Message:
        return {"type": "http.disconnect"}

    async def send(message: Message) -> None:
        sent.append(message)

    async def stop_while_it_is_handled() -> None:
        scope: Any = {"type": "http", "method": "PUT", "path": "/v1/scenes", "headers": []}
        metrics = Metrics()
        context = RequestContext(endless, metrics, LoopLag(metrics.loop_lag), Tracing(), Drain())
        handling = asyncio.create_task(context(scope, receive, send))
        await asyncio.sleep(0)
        handling.cancel()
        await handling

    asyncio.run(stop_while_it_is_handled())
    start, body = sent
    assert start["status"] == 503
    assert (b"retry-after", b"5") in start["headers"]
    assert json.loads(body["body"])["retryable"]


def test_every_response_has_the_date(gateway: Any) -> None:
    for path in ("/livez", "/nowhere"):
        sent = parsedate_to_datetime(gateway.client.get(path).headers["date"])
        assert abs((datetime.now(UTC) - sent).total_seconds()) < 60
