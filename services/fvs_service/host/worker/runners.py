"""The gateway's client of the runners: finds a scene's runner by its lease and connects to it directly."""

import asyncio
import base64
import contextlib
import math
import time
from collections.abc import AsyncGenerator, Callable
from contextlib import AbstractContextManager, aclosing
from typing import Any, TypeAlias, TypeVar

from anyio.to_thread import run_sync
from pydantic import TypeAdapter
from sqlalchemy import delete, select
from sqlalchemy.exc import IntegrityError

from fvs_engine.candidates import CandidateScore
from fvs_engine.plan.plan_records import Plan
from fvs_service.application import Storage
from fvs_service.errors import UnavailableError, deadline_passed
from fvs_service.host.protocol.async_connection import AsyncConnections, exchange, result_of
from fvs_service.host.protocol.connection import RunnerError, RunnerGoneError
from fvs_service.host.protocol.messages import error_of
from fvs_service.rankings.port import (
    ForecastViews,
    GeneratedViews,
    GenerateViews,
    PlanViews,
    RankedViews,
    RankingSteps,
    RankViews,
    RenderView,
    ViewForecasts,
)
from fvs_service.storage.database import Database
from fvs_service.storage.notifications import Topic, announce
from fvs_service.storage.tables import RunnerRequestRow
from fvs_service.tracing import Span

_START_S = 45.0
"""How long a request waits for a scene without a runner: somewhat longer than a runner takes to start."""
_START_AGAIN_S = 2.0
_POLL_S = 0.1
_FEW_VIEWS = 100
_SMALL_BYTES = 16_384
"""Small requests are serialised, and small responses parsed, on the event loop: a thread costs more."""
_SCORES = TypeAdapter(tuple[CandidateScore, ...])

T = TypeVar("T")
_Request: TypeAlias = RankViews | RenderView | GenerateViews | PlanViews | ForecastViews


class RunnerRequests:
    """Gateways' requests for the runners of cold scenes, each taken by whichever worker is first.

    One that is lost with its worker is made again by the waiting ranking.
    """

    def __init__(self, database: Database) -> None:
        self._database = database

    def add(self, scene_id: str) -> None:
        """Have a worker start the scene's runner; no effect while that is requested already."""
        try:
            with self._database.writing() as session:
                if session.get(RunnerRequestRow, scene_id) is None:
                    session.add(RunnerRequestRow(scene_id=scene_id))
                announce(session, Topic.RUNNERS)
        except IntegrityError:
            pass  # requested by another gateway meanwhile

    def take(self) -> str | None:
        """Take one request: the id of its scene; None when there is none."""
        with self._database.reading() as session:
            scene_id = session.scalar(select(RunnerRequestRow.scene_id).limit(1))
        if scene_id is None:
            return None
        with self._database.writing() as session:
            return session.scalar(
                delete(RunnerRequestRow)
                .where(RunnerRequestRow.scene_id == scene_id)
                .returning(RunnerRequestRow.scene_id)
            )


class LeasedRunners:
    """The ``SceneRunners`` of a gateway, found by the leases of their scenes."""

    def __init__(self, storage: Storage) -> None:
        self._leases = storage.leases
        self._requests = RunnerRequests(storage.database)
        self._connections = AsyncConnections()
        self._tracing = storage.tracing

    async def rank(self, request: RankViews) -> RankedViews:
        """See ``SceneRunners``."""
        with self._span(request, len(request.views)) as span:
            ranked = await self._ask(request, RankedViews.model_validate)
            span.add({"fvs.waited_s": ranked.waited_s, "fvs.scoring_s": ranked.seconds})
            return ranked

    async def stream(self, request: RankViews) -> RankingSteps:
        """See ``SceneRunners``."""
        until = time.monotonic() + request.timeout_s
        async with aclosing(self._parts(request.model_copy(update={"streamed": True}), until)) as parts:
            while True:
                try:
                    async with asyncio.timeout(until - time.monotonic()):  # not while the caller has a part
                        part = await anext(parts, None)
                except TimeoutError as error:
                    raise deadline_passed(request.timeout_s) from error
                except RunnerError as error:
                    raise error_of(error.failure) from error
                if part is None:
                    return
                yield part

    async def render(self, request: RenderView) -> bytes:
        """See ``SceneRunners``."""
        with self._span(request, 1):
            return await self._ask(request, base64.b64decode)

    async def generate(self, request: GenerateViews) -> GeneratedViews:
        """See ``SceneRunners``."""
        with self._span(request, request.views.count):
            return await self._ask(request, GeneratedViews.model_validate)

    async def plan(self, request: PlanViews) -> Plan:
        """See ``SceneRunners``."""
        with self._span(request, len(request.views)):
            return await self._ask(request, Plan.model_validate)

    async def forecast(self, request: ForecastViews) -> ViewForecasts:
        """See ``SceneRunners``."""
        with self._span(request, request.surface or len(request.views)):
            return await self._ask(request, ViewForecasts.model_validate)

    async def close(self) -> None:
        """See ``SceneRunners``."""
        self._connections.close()
        await asyncio.sleep(0)  # the event loop closes them in its next round

    def _span(self, request: _Request, views: int) -> AbstractContextManager[Span]:
        return self._tracing.span(
            f"runner: {request.kind}",
            {"fvs.scene_id": request.scene_id, "fvs.snapshot_id": request.snapshot_id, "fvs.views": views},
            kind="CLIENT",
        )

    async def _ask(self, request: _Request, parse: Callable[[Any], T]) -> T:
        """The scene's runner's answer. Large messages are written and read in a thread, not on the loop."""
        until = time.monotonic() + request.timeout_s
        try:
            async with asyncio.timeout(request.timeout_s):
                response = await self._call(request, until)
        except TimeoutError as error:
            raise deadline_passed(request.timeout_s) from error
        try:
            if len(response) <= _SMALL_BYTES:
                return parse(result_of(response))
            return await run_sync(lambda: parse(result_of(response)))
        except RunnerError as error:
            raise error_of(error.failure) from error

    async def _call(self, request: _Request, until: float) -> bytes:
        """The runner's response; repeats the request when the runner died or moved."""
        async with aclosing(self._addressed(request, until)) as addressed:
            async for endpoint, line in addressed:
                with contextlib.suppress(RunnerGoneError):
                    return await self._connections.call(endpoint, line)
        raise AssertionError  # the endpoints do not end

    async def _parts(self, request: RankViews, until: float) -> RankingSteps:
        """The parts that the runner sends; repeats the request when the runner died or moved."""
        async with aclosing(self._addressed(request, until)) as addressed:
            async for endpoint, line in addressed:
                with contextlib.suppress(RunnerGoneError):
                    async with aclosing(exchange(endpoint, line)) as documents:
                        async for document in documents:
                            yield await run_sync(_part, document)
                    return

    async def _addressed(self, request: _Request, until: float) -> AsyncGenerator[tuple[str, bytes], None]:
        """The endpoint of the scene's runner and the request as a line, again and again, until one answers.

        Starts a runner if need be. Raises ``UnavailableError`` when there has been none for too long, or is
        none shortly before the deadline: that says more than a timeout.
        """
        give_up = time.monotonic() + _START_S
        started = -math.inf
        found = request.endpoint
        while True:
            endpoint = found or await run_sync(self._endpoint, request.scene_id)
            found = None  # the scene may have another runner by now
            if endpoint is not None:
                asked = time.monotonic()
                yield endpoint, await _line(request, until)  # of a dead runner too: its lease lasts longer
                give_up += time.monotonic() - asked
            if time.monotonic() - started > _START_AGAIN_S:
                await run_sync(self._requests.add, request.scene_id)
                started = time.monotonic()
            if time.monotonic() > min(give_up, until - 2 * _POLL_S):
                raise UnavailableError(
                    "No worker has loaded the scene's model.",
                    hint="Try again soon: it is being loaded, or waits for memory.",
                    retry_after_s=10,
                )
            await asyncio.sleep(_POLL_S)

    def _endpoint(self, scene_id: str) -> str | None:
        """The endpoint of the scene's runner; None without one."""
        holder = self._leases.holder(scene_id)
        return None if holder is None else holder.endpoint


async def _line(request: _Request, until: float) -> bytes:
    """The request as it is sent, with the time that is left."""
    left = request.model_copy(update={"timeout_s": max(0.0, until - time.monotonic())})
    if isinstance(left, RenderView | GenerateViews) or len(left.views) <= _FEW_VIEWS:
        return left.model_dump_json().encode()
    return (await run_sync(left.model_dump_json)).encode()


def _part(document: Any) -> tuple[CandidateScore, ...] | RankedViews:
    if "part" in document:
        return _SCORES.validate_python(document["part"])
    return RankedViews.model_validate(document["result"])
