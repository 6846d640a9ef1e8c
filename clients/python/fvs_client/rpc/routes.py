"""Routes from the requests of REST to the methods of ``fvs.v1``."""

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any
from urllib.parse import unquote

import httpx2
from google.protobuf.descriptor import MethodDescriptor
from google.protobuf.message import Message

from fvs_client.requests import EVENT_STREAM
from fvs_client.rpc import contract
from fvs_client.rpc.documents import fill

HEALTH = ("GET", "/readyz")
"""Answered by ``grpc.health.v1``, which has a contract of its own."""

_SCENE, _IMAGE = "/v1/scenes/{scene_id}", "/v1/scenes/{scene_id}/images/{digest}"
_SNAPSHOT, _RANKING = "/v1/snapshots/{snapshot_id}", "/v1/rankings/{ranking_id}"
_PLAN = "/v1/plans/{plan_id}"
_WEBHOOK = "/v1/webhooks/{webhook_id}"
_TABLE = (
    ("GET", "/v1/capabilities", "CapabilityService.GetCapabilities"),
    ("POST", "/v1/scenes", "SceneService.CreateScene"),
    ("GET", "/v1/scenes", "SceneService.ListScenes"),
    ("GET", _SCENE, "SceneService.GetScene"),
    ("PATCH", _SCENE, "SceneService.ChangeScene"),
    ("DELETE", _SCENE, "SceneService.DeleteScene"),
    ("GET", f"{_SCENE}/size", "SceneService.GetSceneSize"),
    ("GET", f"{_SCENE}/events", "SceneService.WatchEvents"),
    ("POST", f"{_SCENE}/images:check", "ImageService.CheckImages"),
    ("GET", f"{_SCENE}/images", "ImageService.ListImages"),
    ("PUT", _IMAGE, "ImageService.UploadImage"),
    ("GET", _IMAGE, "ImageService.GetImage"),
    ("DELETE", _IMAGE, "ImageService.DeleteImage"),
    ("POST", f"{_IMAGE}:exclude", "ImageService.ExcludeImage"),
    ("POST", f"{_IMAGE}:include", "ImageService.IncludeImage"),
    ("GET", f"{_IMAGE}/content", "ImageService.DownloadImage"),
    ("POST", f"{_SCENE}/jobs", "JobService.CreateJob"),
    ("GET", f"{_SCENE}/jobs", "JobService.ListJobs"),
    ("GET", "/v1/jobs/{job_id}", "JobService.GetJob"),
    ("POST", "/v1/jobs/{job_id}:cancel", "JobService.CancelJob"),
    ("POST", "/v1/jobs/{job_id}:retry", "JobService.RetryJob"),
    ("GET", f"{_SCENE}/snapshots", "SnapshotService.ListSnapshots"),
    ("GET", _SNAPSHOT, "SnapshotService.GetSnapshot"),
    ("PATCH", _SNAPSHOT, "SnapshotService.ChangeSnapshot"),
    ("DELETE", _SNAPSHOT, "SnapshotService.DeleteSnapshot"),
    ("GET", f"{_SNAPSHOT}/artifacts/{{name}}", "SnapshotService.DownloadArtifact"),
    ("POST", f"{_SCENE}/webhooks", "WebhookService.CreateWebhook"),
    ("GET", f"{_SCENE}/webhooks", "WebhookService.ListWebhooks"),
    ("GET", _WEBHOOK, "WebhookService.GetWebhook"),
    ("POST", f"{_WEBHOOK}:enable", "WebhookService.EnableWebhook"),
    ("DELETE", _WEBHOOK, "WebhookService.DeleteWebhook"),
    ("POST", f"{_SCENE}/rankings", "ViewService.RankViews"),
    ("GET", f"{_SCENE}/rankings", "ViewService.ListRankings"),
    ("POST", f"{_SCENE}/plans", "ViewService.PlanViews"),
    ("GET", f"{_SCENE}/plans", "ViewService.ListPlans"),
    ("GET", _PLAN, "ViewService.GetPlan"),
    ("DELETE", _PLAN, "ViewService.DeletePlan"),
    ("GET", f"{_PLAN}/mission", "ViewService.GetPlanMission"),
    ("POST", f"{_SCENE}/visits", "ViewService.ReportVisits"),
    ("GET", f"{_SCENE}/visits", "ViewService.ListVisits"),
    ("POST", f"{_SCENE}/missions", "ViewService.CreateMission"),
    ("GET", f"{_RANKING}/mission", "ViewService.GetRankingMission"),
    ("GET", _RANKING, "ViewService.GetRanking"),
    ("DELETE", _RANKING, "ViewService.DeleteRanking"),
    ("GET", f"{_RANKING}/candidates/{{candidate_id}}/{{image}}.png", "ViewService.RenderCandidate"),
)
_FLAGS = frozenset({"leave_out", "tail", "takeoff"})
"""Parameters of queries that are true or false."""
_STREAMED = {"RankViews": contract.method("ViewService", "StreamRankViews")}
"""The methods that answer requests which accept a stream of events."""
_ROUTES = tuple(
    (verb, re.compile(re.sub(r"{(\w+)}", r"(?P<\1>[^/]+)", path)), contract.method(*name.split(".")))
    for verb, path, name in _TABLE
)


@dataclass(frozen=True)
class Route:
    """The method for one request, and the variables of the request's path."""

    method: MethodDescriptor
    variables: Mapping[str, str]

    @property
    def name(self) -> str:
        """The method's name without its service."""
        return str(self.method.name)

    @property
    def path(self) -> str:
        """The method's path on the wire."""
        return f"/{self.method.containing_service.full_name}/{self.method.name}"

    def message(self, request: httpx2.Request) -> Message:
        """The request as a message; its body must have been read.

        Raises ``ValueError`` for what the contract cannot express.
        """
        return _message(self.method.input_type.name, self.variables, request)


def route_of(request: httpx2.Request) -> Route:
    """The route of a request; raises ``LookupError`` when no method answers it."""
    path = request.url.raw_path.decode().partition("?")[0]
    for verb, pattern, method in _ROUTES:
        if verb == request.method and (found := pattern.fullmatch(path)) is not None:
            if request.headers.get("Accept") == EVENT_STREAM:
                method = _STREAMED.get(method.name, method)
            return Route(method, {name: unquote(text) for name, text in found.groupdict().items()})
    raise LookupError(f"{request.method} {path} has no counterpart in {contract.PACKAGE}.")


def _message(kind: str, variables: Mapping[str, str], request: httpx2.Request) -> Message:
    message: Message = contract.message(kind)()
    fields = message.DESCRIPTOR.fields_by_name
    headers = {
        "idempotency_key": request.headers.get("Idempotency-Key"),
        "after": request.headers.get("Last-Event-ID"),
        "start": _start(request.headers.get("Range", "")),
        "etag": _tag(request.headers.get("If-Match")),
    }
    given: dict[str, Any] = {**variables, **request.url.params}
    for name in given.keys() & request.url.params.keys():
        if name in fields and fields[name].is_repeated:
            given[name] = request.url.params.get_list(name)
    for name in _FLAGS & given.keys():
        given[name] = given[name] == "true"
    given.update((name, value) for name, value in headers.items() if value is not None and name in fields)
    if request.headers.get("Content-Type") == "application/json":
        body = next(name for name, field in fields.items() if field.message_type is not None)
        given[body] = json.loads(request.content)
    fill(message, given)
    return message


def _tag(if_match: str | None) -> str | None:
    return None if if_match is None else if_match.strip('"')


def _start(content_range: str) -> str | None:
    found = re.fullmatch(r"bytes=(\d+)-", content_range)
    return None if found is None else found[1]
