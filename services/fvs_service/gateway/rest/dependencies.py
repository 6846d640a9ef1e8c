"""Dependencies of handlers: the application, the principal, and parts of requests that routes share."""

from collections.abc import Awaitable, Callable
from typing import Annotated, TypeVar

from anyio import CapacityLimiter
from fastapi import Depends, Header, Path, Query, Request, Response
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.concurrency import run_in_threadpool

from fvs_service.application import Application
from fvs_service.errors import UnauthenticatedError
from fvs_service.events.feed import EventFeed
from fvs_service.ids import new_id
from fvs_service.model import NumberedPage, Page
from fvs_service.principal import Principal, Scope
from fvs_service.telemetry import Metrics

PageT = TypeVar("PageT", bound=Page)

_bearer = HTTPBearer(
    auto_error=False,
    scheme_name="ApiKey",
    description="Create one with `fvs keys create`. Not needed while the service is bound to loopback.",
)


# Coroutines, so that the framework does not call them in threads.
async def _application(request: Request) -> Application:
    application: Application = request.app.state.application
    return application


async def _feed(request: Request) -> EventFeed:
    feed: EventFeed = request.app.state.feed
    return feed


async def _metrics(request: Request) -> Metrics:
    metrics: Metrics = request.app.state.metrics
    return metrics


async def _parsing(request: Request) -> CapacityLimiter:
    limiter: CapacityLimiter = request.app.state.parsing
    return limiter


App = Annotated[Application, Depends(_application)]
Feed = Annotated[EventFeed, Depends(_feed)]
Counters = Annotated[Metrics, Depends(_metrics)]
Parsing = Annotated[CapacityLimiter, Depends(_parsing)]


async def _caller(
    request: Request,
    app: App,
    credentials: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
) -> Principal:
    if credentials is not None:
        principal = await run_in_threadpool(app.storage.keys.authenticate, credentials.credentials)
        request.state.principal = principal
        return principal
    if "authorization" in request.headers:  # a broken credential must not count as none
        raise UnauthenticatedError("The Authorization header is not a Bearer key.")
    return app.storage.keys.authenticate(None)


Caller = Annotated[Principal, Depends(_caller)]


def _page(app: App, page: Annotated[Page, Query()]) -> Page:
    return _within_limits(app, page)


def _numbered_page(app: App, page: Annotated[NumberedPage, Query()]) -> NumberedPage:
    return _within_limits(app, page)


def _within_limits(app: Application, page: PageT) -> PageT:
    most = app.storage.settings.limits.page_items
    return page.model_copy(update={"limit": min(page.limit, most)})


Paging = Annotated[Page, Depends(_page)]
NumberedPaging = Annotated[NumberedPage, Depends(_numbered_page)]
IdempotencyKey = Annotated[
    str | None,
    Header(
        alias="Idempotency-Key",
        min_length=1,
        max_length=255,
        pattern=r"^[\x21-\x7e]+$",
        description="The same request with the same key creates its resource once.",
    ),
]


def _id(prefix: str, what: str) -> object:
    return Path(description=f"The {what}'s id.", max_length=64, examples=[new_id(prefix)])


SceneId = Annotated[str, _id("scn", "scene")]
JobId = Annotated[str, _id("job", "job")]
SnapshotId = Annotated[str, _id("snp", "snapshot")]
RankingId = Annotated[str, _id("rnk", "ranking")]


async def operator(caller: Caller) -> Principal:
    """The caller, who may create scenes."""
    caller.require(Scope.OPERATE)
    return caller


def _of_scene(scope: Scope) -> Callable[..., Awaitable[Principal]]:
    async def permitted(app: App, caller: Caller, scene_id: SceneId) -> Principal:
        await run_in_threadpool(app.scenes.require, caller, scope, scene_id)
        return caller

    return permitted


async def snapshot_operator(app: App, caller: Caller, snapshot_id: SnapshotId) -> Principal:
    """The caller, who may operate the scene of the path's snapshot; it exists."""
    await run_in_threadpool(app.storage.snapshots.require, caller, Scope.OPERATE, snapshot_id)
    return caller


scene_uploader, scene_operator = _of_scene(Scope.UPLOAD), _of_scene(Scope.OPERATE)
SceneUploader = Annotated[Principal, Depends(scene_uploader)]
"""The caller, who may upload to the scene of the path; it exists."""
SceneOperator = Annotated[Principal, Depends(scene_operator)]
"""The caller, who may operate the scene of the path; it exists."""


def set_location(response: Response, path: str) -> None:
    """Set the location of the created resource."""
    response.headers["Location"] = path
