"""The operations of the contract: how each is called in this process, over REST and over gRPC."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

import orjson
from fvs.v1 import (
    capabilities_pb2,
    images_pb2,
    jobs_pb2,
    scenes_pb2,
    snapshots_pb2,
    views_pb2,
    webhooks_pb2,
)
from fvs_service.application import Application
from fvs_service.gateway.capabilities import capabilities_of
from fvs_service.gateway.rest.bodies import parse as parse_body
from fvs_service.principal import Principal

from fvs_schema.base import Page
from fvs_schema.control_points import ControlPoints
from fvs_schema.forecasts import ForecastRequest
from fvs_schema.images import DigestCheck
from fvs_schema.jobs import JobPage, JobRequest
from fvs_schema.missions import MissionOptions, MissionRequest, PlanMissionOptions
from fvs_schema.plans import PlanRequest
from fvs_schema.rankings import RankingRequest
from fvs_schema.renders import RenderRequest, ViewImage
from fvs_schema.scenes import SceneChange, ScenePage, SceneRequest
from fvs_schema.service import Limits
from fvs_schema.snapshots import SnapshotChange
from fvs_schema.visits import VisitReport
from fvs_schema.webhooks import WebhookRequest

_FILES = (
    capabilities_pb2,
    images_pb2,
    jobs_pb2,
    scenes_pb2,
    snapshots_pb2,
    views_pb2,
    webhooks_pb2,
)


@dataclass(frozen=True)
class Operation:
    """One method of ``fvs.v1``: its REST route, and the service call behind both."""

    verb: str
    path: str
    direct: Callable[[Application, Principal, "Call"], Any]
    body: tuple[str, Any] | None = None
    """The field of the request that is REST's body, and its model."""
    streamed: bool = False
    """Whether it answers with a stream: over REST of server-sent events, for who accepts one."""


@dataclass(frozen=True)
class Call:
    """The parameters of a call; ``body`` is the validated model for the services themselves."""

    given: Mapping[str, Any]
    body: Any = None

    def __getattr__(self, name: str) -> Any:
        return self.given.get(name)

    @property
    def expected(self) -> Any:
        return (self.given["etag"],) if "etag" in self.given else None

    def options_of(self, kind: type[MissionOptions] = MissionOptions) -> Any:
        given = {name: self.given[name] for name in kind.model_fields if name in self.given}
        return parse_body(kind, orjson.dumps(given), Limits())

    def page(self, kind: type[Page] = Page) -> Any:
        asked = {name: self.given[name] for name in kind.model_fields if name in self.given}
        return parse_body(kind, orjson.dumps(asked), Limits())


def _render(app: Application, caller: Principal, call: Call) -> Any:
    return app.renders.of_candidate(caller, call.ranking_id, call.candidate_id, ViewImage.RENDER, 60.0)


def _thumbnail(app: Application, caller: Principal, call: Call) -> Any:
    return app.images.thumbnail(app.images.original(caller, call.scene_id, call.digest))


async def _render_view(app: Application, caller: Principal, call: Call) -> Any:
    content, _ = await app.renders.at_pose(caller, call.snapshot_id, lambda: call.body, 60.0)
    return content


def _ranking_mission(app: Application, caller: Principal, call: Call) -> Any:
    return app.missions.of_ranking(caller, call.ranking_id, call.options_of()).content


def _plan_mission(app: Application, caller: Principal, call: Call) -> Any:
    return app.missions.of_plan(caller, call.plan_id, call.options_of(PlanMissionOptions)).content


def _mission(app: Application, caller: Principal, call: Call) -> Any:
    return app.missions.of_views(caller, call.scene_id, lambda: call.body, call.options_of()).content


OPERATIONS: dict[str, Operation] = {
    "CreateScene": Operation(
        "POST",
        "/v1/scenes",
        lambda app, who, call: app.scenes.create(who, call.body, call.idempotency_key),
        ("scene", SceneRequest),
    ),
    "ListScenes": Operation(
        "GET", "/v1/scenes", lambda app, who, call: app.scenes.all(who, call.page(ScenePage))
    ),
    "GetScene": Operation(
        "GET", "/v1/scenes/{scene_id}", lambda app, who, call: app.scenes.get(who, call.scene_id)
    ),
    "ChangeScene": Operation(
        "PATCH",
        "/v1/scenes/{scene_id}",
        lambda app, who, call: app.scenes.change(who, call.scene_id, call.body, call.expected),
        ("change", SceneChange),
    ),
    "DeleteScene": Operation(
        "DELETE",
        "/v1/scenes/{scene_id}",
        lambda app, who, call: app.deletions.scene(who, call.scene_id, call.expected),
    ),
    "SetControlPoints": Operation(
        "PUT",
        "/v1/scenes/{scene_id}/control-points",
        lambda app, who, call: app.scenes.set_control_points(who, call.scene_id, call.body),
        ("points", ControlPoints),
    ),
    "GetControlPoints": Operation(
        "GET",
        "/v1/scenes/{scene_id}/control-points",
        lambda app, who, call: app.scenes.control_points(who, call.scene_id),
    ),
    "DeleteControlPoints": Operation(
        "DELETE",
        "/v1/scenes/{scene_id}/control-points",
        lambda app, who, call: app.scenes.delete_control_points(who, call.scene_id),
    ),
    "GetSceneSize": Operation(
        "GET", "/v1/scenes/{scene_id}/size", lambda app, who, call: app.scenes.size(who, call.scene_id)
    ),
    "CheckImages": Operation(
        "POST",
        "/v1/scenes/{scene_id}/images:check",
        lambda app, who, call: app.images.check(who, call.scene_id, call.body),
        ("check", DigestCheck),
    ),
    "ListImages": Operation(
        "GET",
        "/v1/scenes/{scene_id}/images",
        lambda app, who, call: app.images.of_scene(who, call.scene_id, call.page()),
    ),
    "GetImage": Operation(
        "GET",
        "/v1/scenes/{scene_id}/images/{digest}",
        lambda app, who, call: app.images.get(who, call.scene_id, call.digest),
    ),
    "DeleteImage": Operation(
        "DELETE",
        "/v1/scenes/{scene_id}/images/{digest}",
        lambda app, who, call: app.exclusions.delete(who, call.scene_id, call.digest),
    ),
    "ExcludeImage": Operation(
        "POST",
        "/v1/scenes/{scene_id}/images/{digest}:exclude",
        lambda app, who, call: app.exclusions.exclude(who, call.scene_id, call.digest),
    ),
    "IncludeImage": Operation(
        "POST",
        "/v1/scenes/{scene_id}/images/{digest}:include",
        lambda app, who, call: app.exclusions.include(who, call.scene_id, call.digest),
    ),
    "RemoveMask": Operation(
        "DELETE",
        "/v1/scenes/{scene_id}/images/{digest}/mask",
        lambda app, who, call: app.masks.remove(who, call.scene_id, call.digest),
    ),
    "CreateJob": Operation(
        "POST",
        "/v1/scenes/{scene_id}/jobs",
        lambda app, who, call: app.jobs.create(who, call.scene_id, call.body, call.idempotency_key),
        ("job", JobRequest),
    ),
    "ListJobs": Operation(
        "GET",
        "/v1/scenes/{scene_id}/jobs",
        lambda app, who, call: app.jobs.of_scene(who, call.scene_id, call.page(JobPage)),
    ),
    "GetJob": Operation("GET", "/v1/jobs/{job_id}", lambda app, who, call: app.jobs.get(who, call.job_id)),
    "CancelJob": Operation(
        "POST", "/v1/jobs/{job_id}:cancel", lambda app, who, call: app.jobs.cancel(who, call.job_id)
    ),
    "RetryJob": Operation(
        "POST", "/v1/jobs/{job_id}:retry", lambda app, who, call: app.jobs.retry(who, call.job_id)
    ),
    "ListSnapshots": Operation(
        "GET",
        "/v1/scenes/{scene_id}/snapshots",
        lambda app, who, call: app.storage.snapshots.of_scene(who, call.scene_id, call.page()),
    ),
    "GetSnapshot": Operation(
        "GET",
        "/v1/snapshots/{snapshot_id}",
        lambda app, who, call: app.storage.snapshots.get(who, call.snapshot_id),
    ),
    "ChangeSnapshot": Operation(
        "PATCH",
        "/v1/snapshots/{snapshot_id}",
        lambda app, who, call: app.storage.snapshots.change(who, call.snapshot_id, call.body),
        ("change", SnapshotChange),
    ),
    "DeleteSnapshot": Operation(
        "DELETE",
        "/v1/snapshots/{snapshot_id}",
        lambda app, who, call: app.deletions.snapshot(who, call.snapshot_id),
    ),
    "RankViews": Operation(
        "POST",
        "/v1/scenes/{scene_id}/rankings",
        lambda app, who, call: app.rankings.create(
            who, call.scene_id, lambda: call.body, 60.0, call.idempotency_key
        ),
        ("ranking", RankingRequest),
    ),
    "StreamRankViews": Operation(
        "POST",
        "/v1/scenes/{scene_id}/rankings",
        lambda app, who, call: app.rankings.stream(
            who, call.scene_id, lambda: call.body, 60.0, call.idempotency_key
        ),
        ("ranking", RankingRequest),
        streamed=True,
    ),
    "PlanViews": Operation(
        "POST",
        "/v1/scenes/{scene_id}/plans",
        lambda app, who, call: app.plans.create(
            who, call.scene_id, lambda: call.body, 60.0, call.idempotency_key
        ),
        ("plan", PlanRequest),
    ),
    "ForecastViews": Operation(
        "POST",
        "/v1/scenes/{scene_id}/forecasts",
        lambda app, who, call: app.forecasts.create(who, call.scene_id, lambda: call.body, 60.0),
        ("forecast", ForecastRequest),
    ),
    "ListPlans": Operation(
        "GET",
        "/v1/scenes/{scene_id}/plans",
        lambda app, who, call: app.plans.of_scene(who, call.scene_id, call.page()),
    ),
    "GetPlan": Operation(
        "GET", "/v1/plans/{plan_id}", lambda app, who, call: app.plans.get(who, call.plan_id)
    ),
    "DeletePlan": Operation(
        "DELETE", "/v1/plans/{plan_id}", lambda app, who, call: app.deletions.plan(who, call.plan_id)
    ),
    "GetPlanMission": Operation("GET", "/v1/plans/{plan_id}/mission", _plan_mission),
    "ReportVisits": Operation(
        "POST",
        "/v1/scenes/{scene_id}/visits",
        lambda app, who, call: app.visits.report(who, call.scene_id, call.body),
        ("report", VisitReport),
    ),
    "CreateWebhook": Operation(
        "POST",
        "/v1/scenes/{scene_id}/webhooks",
        lambda app, who, call: app.webhooks.create(who, call.scene_id, call.body),
        ("webhook", WebhookRequest),
    ),
    "ListWebhooks": Operation(
        "GET",
        "/v1/scenes/{scene_id}/webhooks",
        lambda app, who, call: app.webhooks.of_scene(who, call.scene_id),
    ),
    "GetWebhook": Operation(
        "GET", "/v1/webhooks/{webhook_id}", lambda app, who, call: app.webhooks.get(who, call.webhook_id)
    ),
    "EnableWebhook": Operation(
        "POST",
        "/v1/webhooks/{webhook_id}:enable",
        lambda app, who, call: app.webhooks.enable(who, call.webhook_id),
    ),
    "DeleteWebhook": Operation(
        "DELETE",
        "/v1/webhooks/{webhook_id}",
        lambda app, who, call: app.webhooks.delete(who, call.webhook_id),
    ),
    "ListVisits": Operation(
        "GET", "/v1/scenes/{scene_id}/visits", lambda app, who, call: app.visits.of_scene(who, call.scene_id)
    ),
    "GetRanking": Operation(
        "GET", "/v1/rankings/{ranking_id}", lambda app, who, call: app.rankings.get(who, call.ranking_id)
    ),
    "ListRankings": Operation(
        "GET",
        "/v1/scenes/{scene_id}/rankings",
        lambda app, who, call: app.rankings.of_scene(who, call.scene_id, call.page()),
    ),
    "DeleteRanking": Operation(
        "DELETE",
        "/v1/rankings/{ranking_id}",
        lambda app, who, call: app.deletions.ranking(who, call.ranking_id),
    ),
    "RenderCandidate": Operation(
        "GET", "/v1/rankings/{ranking_id}/candidates/{candidate_id}/render.png", _render
    ),
    "RenderView": Operation(
        "POST", "/v1/snapshots/{snapshot_id}/renders", _render_view, ("render", RenderRequest)
    ),
    "GetThumbnail": Operation("GET", "/v1/scenes/{scene_id}/images/{digest}/thumbnail", _thumbnail),
    "GetRankingMission": Operation("GET", "/v1/rankings/{ranking_id}/mission", _ranking_mission),
    "CreateMission": Operation(
        "POST", "/v1/scenes/{scene_id}/missions", _mission, ("mission", MissionRequest)
    ),
    "GetCapabilities": Operation("GET", "/v1/capabilities", lambda app, _who, _call: capabilities_of(app)),
}
"""Every operation with one request, and one response or a stream of JSON, on both transports."""


@cache
def method(name: str) -> Any:
    """The descriptor of a method of ``fvs.v1``."""
    return next(
        service.methods_by_name[name]
        for file in _FILES
        for service in file.DESCRIPTOR.services_by_name.values()
        if name in service.methods_by_name
    )
