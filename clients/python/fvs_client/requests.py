"""Every request that the client sends, as data: the counterpart of the service's OpenAPI document."""

import base64
import uuid
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Any
from urllib.parse import quote

from fvs_client.request import FileBody, Request
from fvs_schema.base import Input
from fvs_schema.control_points import ControlPoints
from fvs_schema.forecasts import ForecastRequest
from fvs_schema.images import ImageMetadata
from fvs_schema.jobs import JobRequest
from fvs_schema.missions import MissionOptions, MissionRequest
from fvs_schema.plans import PlanRequest
from fvs_schema.rankings import RankingRequest
from fvs_schema.renders import RenderRequest
from fvs_schema.scenes import SceneChange, SceneRequest
from fvs_schema.visits import VisitReport
from fvs_schema.webhooks import WebhookRequest

EVENT_STREAM = "text/event-stream"

_RANKING_TIMEOUT_S = 180.0
"""Long enough to load the model of a cold scene and to score 2,000 views on a CPU."""
_ANSWER_ARRIVES_S = 10.0
_EVENTS_TIMEOUT_S = 40.0
"""The service sends a heartbeat every 15 s."""


def capabilities() -> Request:
    """Get the service's capabilities and limits."""
    return Request("GET", "/v1/capabilities")


def health() -> Request:
    """Check that the service is ready."""
    return Request("GET", "/readyz")


def create_scene(scene: SceneRequest, idempotency_key: str | None) -> Request:
    """Create a scene."""
    return _keyed("/v1/scenes", scene, idempotency_key)


def get_scene(scene_id: str) -> Request:
    """Get a scene."""
    return Request("GET", f"/v1/scenes/{_part(scene_id)}")


def change_scene(scene_id: str, change: SceneChange, etag: str | None = None) -> Request:
    """Change a scene, if its tag still is ``etag``."""
    path = f"/v1/scenes/{_part(scene_id)}"
    return Request(
        "PATCH",
        path,
        headers=_if_match(etag),
        document=_document(change),
        repeatable=etag is None,  # the change itself changes the tag
    )


def delete_scene(scene_id: str, etag: str | None = None) -> Request:
    """Delete a scene, if its tag still is ``etag``."""
    return Request("DELETE", f"/v1/scenes/{_part(scene_id)}", headers=_if_match(etag))


def get_scene_size(scene_id: str) -> Request:
    """Get the disk space of a scene."""
    return Request("GET", f"/v1/scenes/{_part(scene_id)}/size")


def change_snapshot(snapshot_id: str, *, pinned: bool) -> Request:
    """Pin or unpin a snapshot."""
    return Request("PATCH", f"/v1/snapshots/{_part(snapshot_id)}", document={"pinned": pinned})


def delete_snapshot(snapshot_id: str) -> Request:
    """Delete a snapshot."""
    return Request("DELETE", f"/v1/snapshots/{_part(snapshot_id)}")


def delete_ranking(ranking_id: str) -> Request:
    """Delete a ranking."""
    return Request("DELETE", f"/v1/rankings/{_part(ranking_id)}")


def list_of(path: str, params: Mapping[str, Any], after: str | None) -> Request:
    """Get a page of a list: the first one, or what follows the cursor ``after``."""
    return Request("GET", path, {**params, **({} if after is None else {"after": after})})


def check_images(scene_id: str, digests: Iterable[str]) -> Request:
    """Check which of these digests (``sha256:…``) the scene has."""
    path = f"/v1/scenes/{_part(scene_id)}/images:check"
    return Request("POST", path, document={"digests": list(digests)})


def put_image(scene_id: str, digest: str, body: bytes | FileBody, metadata: ImageMetadata | None) -> Request:
    """Upload an image whose ``digest`` is ``sha256:…``."""
    checked = base64.b64encode(bytes.fromhex(digest.removeprefix("sha256:"))).decode()
    return Request(
        "PUT",
        f"{images_of(scene_id)}/{digest}",
        {} if metadata is None else _document(metadata),
        {"Repr-Digest": f"sha-256=:{checked}:", "Content-Type": "application/octet-stream"},
        body=body,
    )


def get_image(scene_id: str, digest: str) -> Request:
    """Get an image's record."""
    return Request("GET", f"{images_of(scene_id)}/{_part(digest)}")


def exclude_image(scene_id: str, digest: str) -> Request:
    """Exclude an image; excluding it again changes nothing."""
    return Request("POST", f"{images_of(scene_id)}/{_part(digest)}:exclude")


def include_image(scene_id: str, digest: str) -> Request:
    """Include an image again; including it twice changes nothing."""
    return Request("POST", f"{images_of(scene_id)}/{_part(digest)}:include")


def set_mask(scene_id: str, digest: str, mask: bytes) -> Request:
    """Give an image a mask, a PNG; sending the same one again changes nothing."""
    return Request(
        "PUT", f"{images_of(scene_id)}/{_part(digest)}/mask", {}, {"Content-Type": "image/png"}, body=mask
    )


def remove_mask(scene_id: str, digest: str) -> Request:
    """Take the mask of an image away."""
    return Request("DELETE", f"{images_of(scene_id)}/{_part(digest)}/mask")


def set_subtitles(scene_id: str, digest: str, subtitles: bytes) -> Request:
    """Send the subtitles of a video, before the video."""
    path = f"{images_of(scene_id)}/{_part(digest)}/subtitles"
    return Request("PUT", path, {}, {"Content-Type": "application/octet-stream"}, body=subtitles)


def delete_image(scene_id: str, digest: str) -> Request:
    """Delete an image."""
    return Request("DELETE", f"{images_of(scene_id)}/{_part(digest)}")


def images_of(scene_id: str) -> str:
    """Path of a scene's list of images."""
    return f"/v1/scenes/{_part(scene_id)}/images"


def create_job(scene_id: str, job: JobRequest, idempotency_key: str | None) -> Request:
    """Create a job."""
    return _keyed(jobs_of(scene_id), job, idempotency_key)


def jobs_of(scene_id: str) -> str:
    """Path of a scene's list of jobs."""
    return f"/v1/scenes/{_part(scene_id)}/jobs"


def get_job(job_id: str, wait_s: float = 0.0) -> Request:
    """Get a job; the service waits for at most ``wait_s`` until its state has changed."""
    path = f"/v1/jobs/{_part(job_id)}"
    if not wait_s:
        return Request("GET", path)
    return Request("GET", path, {"wait_s": wait_s}, read_timeout_s=wait_s + _ANSWER_ARRIVES_S)


def cancel_job(job_id: str) -> Request:
    """Cancel a job; a job that has ended stays unchanged, so the request is repeatable."""
    return Request("POST", f"/v1/jobs/{_part(job_id)}:cancel")


def retry_job(job_id: str) -> Request:
    """Queue a failed or canceled job again; not repeatable: the second request gets a conflict."""
    return Request("POST", f"/v1/jobs/{_part(job_id)}:retry", repeatable=False)


def watch_events(scene_id: str, after: int | None, timeout_s: float | None = None) -> Request:
    """Stream a scene's events after number ``after``; None: only new ones."""
    resumed = after is not None and after > 0
    return Request(
        "GET",
        f"/v1/scenes/{_part(scene_id)}/events",
        {"tail": "true"} if after is None else {},
        {"Accept": EVENT_STREAM, **({"Last-Event-ID": str(after)} if resumed else {})},
        read_timeout_s=timeout_s or _EVENTS_TIMEOUT_S,
    )


def create_ranking(
    scene_id: str,
    ranking: RankingRequest,
    idempotency_key: str | None,
    timeout_s: float | None = None,
    *,
    streamed: bool = False,
) -> Request:
    """Create a ranking; the service computes it for at most ``timeout_s``.

    When ``streamed``, the answer is a stream of events, with candidates as they are scored.
    """
    request = _keyed(rankings_of(scene_id), ranking, idempotency_key)
    if streamed:
        request = replace(request, headers={**request.headers, "Accept": EVENT_STREAM})
    return _computed(request, timeout_s)


def rankings_of(scene_id: str) -> str:
    """Path of a scene's list of rankings."""
    return f"/v1/scenes/{_part(scene_id)}/rankings"


def set_control_points(scene_id: str, points: ControlPoints) -> Request:
    """Set the control points of a scene."""
    return Request("PUT", _control_points_of(scene_id), document=_document(points))


def get_control_points(scene_id: str) -> Request:
    """Get the control points of a scene."""
    return Request("GET", _control_points_of(scene_id))


def delete_control_points(scene_id: str) -> Request:
    """Delete the control points of a scene."""
    return Request("DELETE", _control_points_of(scene_id))


def _control_points_of(scene_id: str) -> str:
    return f"/v1/scenes/{_part(scene_id)}/control-points"


def report_visits(scene_id: str, report: VisitReport) -> Request:
    """Report what a vehicle does about views."""
    return Request("POST", f"/v1/scenes/{_part(scene_id)}/visits", document=_document(report))


def create_webhook(scene_id: str, webhook: WebhookRequest) -> Request:
    """Create a webhook."""
    return Request("POST", f"/v1/scenes/{_part(scene_id)}/webhooks", document=_document(webhook))


def list_webhooks(scene_id: str) -> Request:
    """List the webhooks of a scene."""
    return Request("GET", f"/v1/scenes/{_part(scene_id)}/webhooks")


def get_webhook(webhook_id: str) -> Request:
    """Get a webhook."""
    return Request("GET", f"/v1/webhooks/{_part(webhook_id)}")


def enable_webhook(webhook_id: str) -> Request:
    """Try the deliveries of a webhook now."""
    return Request("POST", f"/v1/webhooks/{_part(webhook_id)}:enable")


def delete_webhook(webhook_id: str) -> Request:
    """Delete a webhook."""
    return Request("DELETE", f"/v1/webhooks/{_part(webhook_id)}")


def list_visits(scene_id: str) -> Request:
    """List what vehicles do about views."""
    return Request("GET", f"/v1/scenes/{_part(scene_id)}/visits")


def create_plan(scene_id: str, plan: PlanRequest, key: str | None, timeout_s: float | None) -> Request:
    """Plan a flight; the service computes it for at most ``timeout_s``."""
    return _computed(_keyed(plans_of(scene_id), plan, key), timeout_s)


def plans_of(scene_id: str) -> str:
    """Path of a scene's list of plans."""
    return f"/v1/scenes/{_part(scene_id)}/plans"


def create_forecast(scene_id: str, forecast: ForecastRequest, timeout_s: float | None) -> Request:
    """Forecast views or the surface; the service computes it for at most ``timeout_s``."""
    path = f"/v1/scenes/{_part(scene_id)}/forecasts"
    return _computed(Request("POST", path, document=_document(forecast)), timeout_s)


def get_plan(plan_id: str) -> Request:
    """Get a plan."""
    return Request("GET", f"/v1/plans/{_part(plan_id)}")


def delete_plan(plan_id: str) -> Request:
    """Delete a plan."""
    return Request("DELETE", f"/v1/plans/{_part(plan_id)}")


def get_plan_mission(plan_id: str, vehicle: int, options: MissionOptions) -> Request:
    """Get the stops of one vehicle of a plan as a mission."""
    return Request("GET", f"/v1/plans/{_part(plan_id)}/mission", {"vehicle": vehicle, **_query(options)})


def get_ranking_mission(ranking_id: str, options: MissionOptions) -> Request:
    """Get the ranked candidates of a ranking as a mission."""
    return Request("GET", f"/v1/rankings/{_part(ranking_id)}/mission", _query(options))


def create_mission(scene_id: str, mission: MissionRequest, options: MissionOptions) -> Request:
    """Get views as a mission."""
    path = f"/v1/scenes/{_part(scene_id)}/missions"
    return Request("POST", path, _query(options), document=_document(mission))


def get_ranking(ranking_id: str) -> Request:
    """Get a ranking."""
    return Request("GET", f"/v1/rankings/{_part(ranking_id)}")


def get_candidate_image(ranking_id: str, candidate_id: str, kind: str) -> Request:
    """Get the PNG of a candidate's ``render`` or ``spectrum``."""
    path = f"/v1/rankings/{_part(ranking_id)}/candidates/{_part(candidate_id)}/{kind}.png"
    return _computed(Request("GET", path), None)


def render_view(snapshot_id: str, render: RenderRequest) -> Request:
    """Get the image of a snapshot at a pose."""
    path = f"/v1/snapshots/{_part(snapshot_id)}/renders"
    return _computed(Request("POST", path, document=_document(render)), None)


def snapshots_of(scene_id: str) -> str:
    """Path of a scene's list of snapshots."""
    return f"/v1/scenes/{_part(scene_id)}/snapshots"


def get_snapshot(snapshot_id: str) -> Request:
    """Get a snapshot."""
    return Request("GET", f"/v1/snapshots/{_part(snapshot_id)}")


def artifact_of(snapshot_id: str, name: str) -> str:
    """Path of an artifact of a snapshot."""
    return f"/v1/snapshots/{_part(snapshot_id)}/artifacts/{_part(name)}"


def original_of(scene_id: str, digest: str) -> str:
    """Path of the bytes of an image."""
    return f"{images_of(scene_id)}/{_part(digest)}/content"


def get_thumbnail(scene_id: str, digest: str) -> Request:
    """Get the thumbnail of an image."""
    return Request("GET", f"{images_of(scene_id)}/{_part(digest)}/thumbnail")


def read_content(path: str, start: int = 0, tag: str | None = None) -> Request:
    """Get an artifact or an original, from byte ``start`` if its ETag is still ``tag``."""
    headers: dict[str, str] = {"Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if tag is not None:
            headers["If-Range"] = tag
    return Request("GET", path, headers=headers)


def _computed(request: Request, timeout_s: float | None) -> Request:
    """The request with how long the client waits, and a little longer for the answer to arrive."""
    within_s = _RANKING_TIMEOUT_S if timeout_s is None else timeout_s
    return replace(
        request,
        headers={**request.headers, "X-Timeout-S": f"{within_s:g}"},
        read_timeout_s=within_s + _ANSWER_ARRIVES_S,
    )


def _keyed(path: str, content: Input, idempotency_key: str | None) -> Request:
    """A POST that creates its resource once, however often it is sent."""
    return Request(
        "POST",
        path,
        headers={"Idempotency-Key": idempotency_key or uuid.uuid4().hex},
        document=_document(content),
    )


def _query(options: MissionOptions) -> dict[str, Any]:
    """The options that differ from the defaults."""
    return options.model_dump(mode="json", exclude_none=True, exclude_defaults=True)


def _document(content: Input) -> dict[str, Any]:
    """The JSON object, without fields that are None."""
    return content.model_dump(mode="json", exclude_none=True)


def _if_match(etag: str | None) -> dict[str, str]:
    return {} if etag is None else {"If-Match": f'"{etag}"'}


def _part(value: Any) -> str:
    """Quote a path segment, so that an id cannot change the path."""
    return quote(str(value), safe=":@+~._-") if value not in (".", "..") else "%2E" * len(value)
