"""Rankings that are streamed, as server-sent events (WHATWG HTML, section 9.2)."""

from collections.abc import AsyncGenerator
from contextlib import aclosing

from fastapi import Request
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool
from starlette.types import Receive, Scope, Send

from fvs_schema.rankings import RankingPart
from fvs_service.errors import ServiceError
from fvs_service.gateway.rest.patience import while_connected
from fvs_service.gateway.rest.problems import problem_response
from fvs_service.telemetry import Metrics

MEDIA_TYPE = "text/event-stream"


class _Stream(StreamingResponse):
    """A response that ends what makes it as soon as its client hangs up."""

    def __init__(self, content: AsyncGenerator[str, None]) -> None:
        super().__init__(content, media_type=MEDIA_TYPE)
        self._content = content

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Send it."""
        async with aclosing(self._content):
            await super().__call__(scope, receive, send)


async def ranking_stream(
    request: Request, metrics: Metrics, parts: AsyncGenerator[RankingPart, None]
) -> StreamingResponse:
    """A message with the JSON of each part; an error after the first part is an event ``problem``.

    Raises what fails before, as requests without a stream do, and ``ClientGoneError``.
    """
    messages = _messages(request, metrics, parts)
    return _Stream(_together(await while_connected(request, anext(messages)), messages))


async def _messages(
    request: Request, metrics: Metrics, parts: AsyncGenerator[RankingPart, None]
) -> AsyncGenerator[str, None]:
    begun = False
    with metrics.rankings_open.track_inprogress():
        try:
            async with aclosing(parts):
                async for part in parts:
                    if (made := part.ranking) is not None:
                        metrics.count_ranking(made.request.method, made.seconds, made.waited_s)
                    yield f"data: {await run_in_threadpool(part.model_dump_json)}\n\n"
                    begun = True
        except ServiceError as error:
            if not begun:
                raise
            problem = bytes(problem_response(request, error).body).decode()
            yield f"event: problem\ndata: {problem}\n\n"


async def _together(first: str, rest: AsyncGenerator[str, None]) -> AsyncGenerator[str, None]:
    async with aclosing(rest):
        yield first
        async for message in rest:
            yield message
