"""Events over REST, as server-sent events (WHATWG HTML, section 9.2)."""

from collections.abc import AsyncIterator
from contextlib import ExitStack, suppress
from typing import Annotated

from fastapi import Header, Query, Request, Response
from fastapi.responses import StreamingResponse
from starlette.concurrency import run_in_threadpool

from fvs_schema.events import Event
from fvs_service.errors import UnauthenticatedError
from fvs_service.events.feed import EventFeed
from fvs_service.gateway.rest.dependencies import Caller, Counters, Feed, SceneId
from fvs_service.gateway.rest.routing import json_router
from fvs_service.principal import Principal
from fvs_service.telemetry import Metrics

router = json_router("/v1/scenes", "events")

_LastEvent = Annotated[
    int | None,
    Header(
        alias="Last-Event-ID",
        ge=0,
        le=2**53,
        description="Start after this event, the last one that arrived; goes before `after`.",
    ),
]
_MEDIA_TYPE = "text/event-stream"
_RECONNECT_MS = 1000
_HEARTBEAT = ": heartbeat\n\n"
_STREAM = {
    200: {
        "description": "Events as they happen.",
        "content": {_MEDIA_TYPE: {"schema": {"type": "string"}}},
    }
}


@router.get("/{scene_id}/events", response_class=StreamingResponse, responses=_STREAM)  # type: ignore[arg-type]
async def watch_events(
    request: Request,
    feed: Feed,
    caller: Caller,
    metrics: Counters,
    scene_id: SceneId,
    after: Annotated[int, Query(ge=0, le=2**53, description="Start after this event.")] = 0,
    tail: Annotated[bool, Query(description="Only new events: start after the newest one.")] = False,
    last: _LastEvent = None,
) -> Response:
    """Stream the events of a scene: the past ones after `Last-Event-ID` (or `after`), then new ones."""
    await run_in_threadpool(feed.check, caller, scene_id)
    if request.method == "HEAD":  # whose response must end
        return Response(media_type=_MEDIA_TYPE)
    if tail and last is None:
        after = await feed.newest()
    slot = ExitStack()
    slot.enter_context(feed.stream_limit.slot(caller.tenant_id))
    stream = _stream(feed, metrics, slot, caller, scene_id, after if last is None else last)
    return StreamingResponse(stream, media_type=_MEDIA_TYPE)


async def _stream(
    feed: EventFeed, metrics: Metrics, slot: ExitStack, caller: Principal, scene_id: str, after: int
) -> AsyncIterator[str]:
    # A client whose key is no longer valid gets the error when it connects again.
    with slot, metrics.streams.track_inprogress(), suppress(UnauthenticatedError):
        # With this id a client that skipped past events can resume before the first new one.
        yield f"retry: {_RECONNECT_MS}\nid: {after}\n\n"
        async for event in feed.follow(caller, scene_id, after):
            yield _HEARTBEAT if event is None else _message(event)


def _message(event: Event) -> str:
    return f"id: {event.number}\nevent: {event.kind.value}\ndata: {event.model_dump_json()}\n\n"
