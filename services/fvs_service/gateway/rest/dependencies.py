"""Dependencies of handlers: the application, the principal, and parts of requests that routes share."""

from collections.abc import Callable
from functools import partial
from typing import Annotated, TypeAlias

from anyio import CapacityLimiter
from fastapi import Depends, Header, Path, Query, Request, Response
from fastapi.security import HTTPAuthorizationCredentials, HTTPBearer
from starlette.concurrency import run_in_threadpool

from fvs_schema.base import Page
from fvs_schema.error_codes import FieldError
from fvs_schema.jobs import JobPage
from fvs_schema.scenes import ScenePage
from fvs_service.application import Application
from fvs_service.errors import InvalidRequestError, UnauthenticatedError
from fvs_service.events.feed import EventFeed
from fvs_service.gateway.drain import Drain
from fvs_service.gateway.rest.routing import JsonRoute
from fvs_service.ids import new_id
from fvs_service.principal import Principal, Scope
from fvs_service.telemetry import Metrics

_bearer = HTTPBearer(
    auto_error=False,
    scheme_name="ApiKey",
    description="Create one with `fvs keys create`. Not needed before a key was created, on loopback.",
)


_SHOWN = 100
"""Maximum length of a name in an error."""


def application_of(request: Request) -> Application:
    """The gateway's application, for dependencies: one on ``App`` would be resolved again in each of them."""
    application: Application = request.app.state.application
    return application


# Coroutines, so that the framework does not call them in threads.
async def _application(request: Request) -> Application:
    return application_of(request)


async def _feed(request: Request) -> EventFeed:
    feed: EventFeed = request.app.state.feed
    return feed


async def _metrics(request: Request) -> Metrics:
    metrics: Metrics = request.app.state.metrics
    return metrics


async def _drain(request: Request) -> Drain:
    drain: Drain = request.app.state.drain
    return drain


async def _parsing(request: Request) -> CapacityLimiter:
    limiter: CapacityLimiter = request.app.state.parsing
    return limiter


App = Annotated[Application, Depends(_application)]
Feed = Annotated[EventFeed, Depends(_feed)]
Counters = Annotated[Metrics, Depends(_metrics)]
Draining = Annotated[Drain, Depends(_drain)]
Parsing = Annotated[CapacityLimiter, Depends(_parsing)]


async def _caller(
    request: Request,
    credentials: Annotated[HTTPAuthorizationCredentials | None, Depends(_bearer)],
) -> Principal:
    keys = application_of(request).storage.keys
    if credentials is not None:
        principal = await run_in_threadpool(keys.authenticate, credentials.credentials)
        request.state.principal = principal
    elif "authorization" in request.headers:  # a broken credential must not count as none
        raise UnauthenticatedError(
            "The Authorization header is not a Bearer key.", hint="Send Authorization: Bearer fvs_…"
        )
    else:
        principal = await run_in_threadpool(keys.authenticate, None)
    await _require_known_query(request)
    return principal


Caller = Annotated[Principal, Depends(_caller)]
"""The principal of the API key; without a right one, and with an unknown parameter, the request fails."""


async def _require_known_query(request: Request) -> None:
    """Raise ``InvalidRequestError`` for a parameter that the route does not have, or that comes twice."""
    if not request.url.query:
        return
    route = request.scope.get("route")
    known = route.parameters if isinstance(route, JsonRoute) else {}
    names = [name for name, _ in request.query_params.multi_items()]
    for name in names:
        shown = name[:_SHOWN]
        if name not in known:
            have = ", ".join(sorted(known))
            raise InvalidRequestError(
                f"There is no parameter {shown!r}.",
                hint=f"The parameters are {have}." if have else "Leave it out: there are none here.",
                errors=[FieldError(shown, "there is no such parameter")],
            )
        if names.count(name) > 1 and not known[name]:
            raise InvalidRequestError(
                f"The parameter {shown!r} is given twice.",
                hint="Give it once.",
                errors=[FieldError(shown, "it is given twice")],
            )


KnownQuery = Depends(_require_known_query)
"""For routes without a caller."""


Paging = Annotated[Page, Query()]
ScenePaging = Annotated[ScenePage, Query()]
JobPaging = Annotated[JobPage, Query()]
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
PlanId = Annotated[str, _id("pln", "plan")]
WebhookId = Annotated[str, _id("whk", "webhook")]


Permission: TypeAlias = Callable[[], None]
"""Checks the caller's permission for the route, in a thread; raises ``ServiceError``."""


async def to_create_scenes(caller: Caller) -> Permission:
    """The permission to create scenes."""
    return partial(caller.require, Scope.OPERATE)


async def to_upload(request: Request, caller: Caller, scene_id: SceneId) -> Permission:
    """The permission to upload to the scene of the path, which exists."""
    return partial(application_of(request).scenes.require, caller, Scope.UPLOAD, scene_id)


async def to_operate(request: Request, caller: Caller, scene_id: SceneId) -> Permission:
    """The permission to operate the scene of the path, which exists."""
    return partial(application_of(request).scenes.require, caller, Scope.OPERATE, scene_id)


async def to_read(request: Request, caller: Caller, scene_id: SceneId) -> Permission:
    """The permission to read the scene of the path, which exists."""
    return partial(application_of(request).scenes.require, caller, Scope.READ, scene_id)


async def to_operate_snapshot(request: Request, caller: Caller, snapshot_id: SnapshotId) -> Permission:
    """The permission to operate the scene of the path's snapshot, which exists."""
    snapshots = application_of(request).storage.snapshots
    return partial(snapshots.require, caller, Scope.OPERATE, snapshot_id)


async def to_read_snapshot(request: Request, caller: Caller, snapshot_id: SnapshotId) -> Permission:
    """The permission to read the scene of the path's snapshot, which exists."""
    snapshots = application_of(request).storage.snapshots
    return partial(snapshots.require, caller, Scope.READ, snapshot_id)


async def _uploader(caller: Caller, permission: Annotated[Permission, Depends(to_upload)]) -> Principal:
    await run_in_threadpool(permission)
    return caller


SceneUploader = Annotated[Principal, Depends(_uploader)]
"""The caller, who may upload to the scene of the path; it exists."""


def set_location(response: Response, path: str) -> None:
    """Set the location of the created resource."""
    response.headers["Location"] = path
