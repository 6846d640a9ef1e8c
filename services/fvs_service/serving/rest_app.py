"""The REST gateway as an ASGI application."""

import asyncio
import contextlib
import importlib.metadata
from collections.abc import AsyncIterator, Callable, Coroutine
from typing import Any

import anyio
import anyio.to_thread
from fastapi import FastAPI

from fvs_service.application import MakeRunners, open_application
from fvs_service.console.page import console_router
from fvs_service.events import rest as events
from fvs_service.events.feed import EventFeed
from fvs_service.forecasts import rest as forecasts
from fvs_service.gateway.drain import Drain
from fvs_service.gateway.loop_lag import LoopLag
from fvs_service.gateway.refusals import Refusals
from fvs_service.gateway.rest import capabilities, openapi, pages, problems, service
from fvs_service.gateway.rest.body_guard import BodyGuard
from fvs_service.gateway.rest.cross_origin import CrossOrigin
from fvs_service.gateway.rest.middleware import RequestContext
from fvs_service.gateway.rest.origins import OriginGuard
from fvs_service.gateway.rest.refusal_guard import RefusalGuard
from fvs_service.gateway.rest.routing import JsonRoute
from fvs_service.images import rest as images
from fvs_service.images import rest_forms as forms
from fvs_service.images import rest_uploads as uploads
from fvs_service.images.rest_tus import TusProtocol
from fvs_service.jobs import rest as jobs
from fvs_service.jobs.fleet_metrics import FleetCollector
from fvs_service.missions import rest as missions
from fvs_service.plans import rest as plans
from fvs_service.rankings import rest as rankings
from fvs_service.scenes import rest as scenes
from fvs_service.settings import Settings
from fvs_service.snapshots import rest as snapshots
from fvs_service.storage.notifications import Topic
from fvs_service.telemetry import Metrics
from fvs_service.tracing import Tracing
from fvs_service.visits import rest as visits
from fvs_service.webhooks import rest as webhooks
from fvs_service.webhooks.deliveries import Deliveries
from fvs_service.webhooks.sending import Sender

_THREADS = 160
"""Threads of handlers that may wait at the same time, for the database or for a runner."""
_PARSERS = 1
"""Threads that parse bodies: they hold the interpreter, and more would only keep the event loop from it."""


_RESOURCES = (
    scenes,
    images,
    forms,
    uploads,
    jobs,
    events,
    rankings,
    plans,
    forecasts,
    visits,
    missions,
    snapshots,
    webhooks,
    capabilities,
)


def create_app(settings: Settings, make_runners: MakeRunners) -> FastAPI:
    """The gateway; it opens the services when it starts and closes them when it stops.

    Without REST it has health and metrics alone.
    """
    metrics, tracing = Metrics(), Tracing.of_environment("fvs-gateway")
    loop_lag = LoopLag(metrics.loop_lag)
    drain = Drain()
    refusals = Refusals(settings.limits.refusals_per_key, metrics)

    @contextlib.asynccontextmanager
    async def lifespan(app: FastAPI) -> AsyncIterator[None]:
        anyio.to_thread.current_default_thread_limiter().total_tokens = _THREADS
        with open_application(settings, make_runners, tracing) as application:
            application.uploads.clear()
            feed = EventFeed(
                application.storage.database,
                application.storage.keys,
                application.scenes.get,
                heartbeat_s=settings.event_heartbeat_s,
                streams_per_tenant=settings.limits.event_streams_per_tenant,
            )
            app.state.application, app.state.feed, app.state.metrics = application, feed, metrics
            fleet = FleetCollector(
                application.storage.database, settings.root, application.store_check.require
            )
            metrics.registry.register(fleet)
            app.state.loop_lag, app.state.parsing = loop_lag, anyio.CapacityLimiter(_PARSERS)
            notified: list[Callable[[], object]] = [feed.notify]
            delivering: tuple[Coroutine[Any, Any, None], ...] = ()
            if not application.destinations.none:
                sender = Sender(application.destinations)
                deliveries = Deliveries(application.storage.database, sender)
                notified.append(deliveries.notify)
                delivering = (deliveries.run(),)
            watching = asyncio.gather(
                *delivering,
                feed.watch(),
                loop_lag.watch(),
                application.uploads.prune_regularly(settings.sweep_s),
            )
            subscription = application.storage.database.subscribe(
                {Topic.EVENTS: lambda: [notify() for notify in notified]}
            )
            try:
                yield
            finally:
                await anyio.to_thread.run_sync(subscription.close)
                watching.cancel()
                await asyncio.gather(watching, return_exceptions=True)
                await application.runners.close()
                await anyio.to_thread.run_sync(tracing.close)

    app = FastAPI(
        title="Frequency View Selection",
        version=importlib.metadata.version("fvs"),
        lifespan=lifespan,
        docs_url=None,  # its pages load scripts from other hosts; ``pages`` has one that does not
        redoc_url=None,
        redirect_slashes=False,
        generate_unique_id_function=lambda route: route.name,
    )
    app.state.refusals, app.state.drain = refusals, drain
    app.add_middleware(BodyGuard, settings=settings, metrics=metrics)
    app.add_middleware(RefusalGuard, refusals=refusals)
    app.add_middleware(OriginGuard, settings=settings)
    app.add_middleware(TusProtocol)
    app.add_middleware(RequestContext, metrics=metrics, loop_lag=loop_lag, tracing=tracing, drain=drain)
    if settings.allowed_origins:
        app.add_middleware(CrossOrigin, origins=settings.allowed_origins)  # the outermost
    problems.install(app)
    bodies = []
    for module in (*_RESOURCES, service) if settings.rest else (service,):
        app.include_router(module.router)
        bodies += [
            route.body for route in module.router.routes if isinstance(route, JsonRoute) and route.body
        ]
    if settings.rest:
        app.include_router(pages.router)
        app.include_router(console_router(settings))
    openapi.describe(app, bodies, keys_required=settings.keys_required is True)
    return app
