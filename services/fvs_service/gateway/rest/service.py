"""Health and metrics over HTTP, for those who operate the service."""

from typing import Annotated

from fastapi import Query, Response
from prometheus_client import CONTENT_TYPE_LATEST, generate_latest

from fvs_schema.service import Health
from fvs_service.errors import stopping
from fvs_service.gateway.readiness import require_ready
from fvs_service.gateway.rest.dependencies import App, Caller, Counters, Draining, KnownQuery
from fvs_service.gateway.rest.routing import json_router

router = json_router("", "service")

_Workers = Annotated[
    int,
    Query(ge=0, le=10_000, description="Number of workers that must be alive; 0 checks only the gateway."),
]
_TEXT = {
    200: {
        "description": "Prometheus' text format.",
        "content": {"text/plain": {"schema": {"type": "string"}}},
    }
}


@router.get("/livez", dependencies=[KnownQuery])
def check_liveness() -> Health:
    """Check that the gateway runs."""
    return Health(status="ok")


@router.get("/readyz", dependencies=[KnownQuery])
def check_readiness(app: App, drain: Draining, workers: _Workers = 0) -> Health:
    """Check that the gateway can store images, and that enough workers are alive; 503 or 507 otherwise."""
    if drain.begun:
        raise stopping()
    require_ready(app, workers)
    return Health(status="ok")


@router.get("/metrics", response_class=Response, responses=_TEXT)  # type: ignore[arg-type]
def get_metrics(counters: Counters, _caller: Caller) -> Response:
    """Return the metrics for Prometheus."""
    return Response(generate_latest(counters.registry), media_type=CONTENT_TYPE_LATEST)
