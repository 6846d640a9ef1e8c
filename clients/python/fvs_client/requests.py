"""Every request that the client sends, as data: one place to compare with the service's OpenAPI document."""

import base64
import uuid
from collections.abc import Iterable, Mapping
from typing import Any
from urllib.parse import quote

from fvs_client.effects import FileBody, Request
from fvs_client.models.base import Input
from fvs_client.models.images import ImageMetadata
from fvs_client.models.jobs import JobKind, JobRequest
from fvs_client.models.rankings import Candidate, Generator, Pose, RankingRequest
from fvs_client.models.scenes import AutomaticWorld, CameraPrior, Policy, SceneRequest, World

Candidates = Mapping[str, Pose] | Iterable[Candidate]
"""Poses by their ids, or ``Candidate``s."""

_RANKING_TIMEOUT_S = 180.0
"""A cold scene is warmed first, and 2,000 views take their time on a processor."""
_EVENTS_TIMEOUT_S = 40.0
"""The service says every 15 s that it lives."""


def capabilities() -> Request:
    """What the service can do."""
    return Request("GET", "/v1/capabilities")


def health() -> Request:
    """Whether the service can take what it is sent."""
    return Request("GET", "/readyz")


def create_scene(
    name: str,
    world: World | None,
    camera: CameraPrior | None,
    policy: Policy | None,
    idempotency_key: str | None,
) -> Request:
    """Make a scene."""
    request = SceneRequest(
        name=name, world=world or AutomaticWorld(), camera=camera, policy=policy or Policy()
    )
    return _keyed("/v1/scenes", request, idempotency_key)


def get_scene(scene_id: str) -> Request:
    """Show a scene."""
    return Request("GET", f"/v1/scenes/{_part(scene_id)}")


def list_of(path: str, after: str | None, limit: int | None) -> Request:
    """A page of a list."""
    given = {"after": after, "limit": limit}
    return Request("GET", path, {name: value for name, value in given.items() if value is not None})


def check_images(scene_id: str, digests: Iterable[str]) -> Request:
    """Ask which of these images the scene has."""
    path = f"/v1/scenes/{_part(scene_id)}/images:check"
    return Request("POST", path, document={"digests": list(digests)})


def put_image(scene_id: str, digest: str, body: bytes | FileBody, metadata: ImageMetadata | None) -> Request:
    """Send an image's bytes; ``digest`` is ``sha256:…``."""
    checked = base64.b64encode(bytes.fromhex(digest.removeprefix("sha256:"))).decode()
    return Request(
        "PUT",
        f"{images_of(scene_id)}/{digest}",
        {} if metadata is None else metadata.document(),
        {"Repr-Digest": f"sha-256=:{checked}:", "Content-Type": "application/octet-stream"},
        body=body,
    )


def get_image(scene_id: str, digest: str) -> Request:
    """Show an image."""
    return Request("GET", f"{images_of(scene_id)}/{_part(digest)}")


def images_of(scene_id: str) -> str:
    """Where a scene's images are listed."""
    return f"/v1/scenes/{_part(scene_id)}/images"


def create_job(
    scene_id: str,
    kind: JobKind | str,
    iterations: int | None,
    long_side_px: int | None,
    test_every: int | None,
    idempotency_key: str | None,
) -> Request:
    """Queue a job."""
    request = JobRequest(
        kind=JobKind(kind), iterations=iterations, long_side_px=long_side_px, test_every=test_every
    )
    return _keyed(jobs_of(scene_id), request, idempotency_key)


def jobs_of(scene_id: str) -> str:
    """Where a scene's jobs are listed."""
    return f"/v1/scenes/{_part(scene_id)}/jobs"


def get_job(job_id: str) -> Request:
    """Show a job."""
    return Request("GET", f"/v1/jobs/{_part(job_id)}")


def cancel_job(job_id: str) -> Request:
    """Stop a job; one that has ended stays as it is, so asking twice does no harm."""
    return Request("POST", f"/v1/jobs/{_part(job_id)}:cancel")


def retry_job(job_id: str) -> Request:
    """Queue a failed or canceled job again; asked twice, the second is refused."""
    return Request("POST", f"/v1/jobs/{_part(job_id)}:retry", repeatable=False)


def watch_events(scene_id: str, after: int | None, timeout_s: float | None = None) -> Request:
    """A scene's events after number ``after``; without it those that come from now on."""
    resumed = after is not None and after > 0
    return Request(
        "GET",
        f"/v1/scenes/{_part(scene_id)}/events",
        {"tail": "true"} if after is None else {},
        {"Accept": "text/event-stream", **({"Last-Event-ID": str(after)} if resumed else {})},
        read_timeout_s=timeout_s or _EVENTS_TIMEOUT_S,
    )


def create_ranking(
    scene_id: str,
    *,
    candidates: Candidates | None,
    generator: Generator | None,
    current_pose: Pose | None,
    radius_m: float | None,
    top_k: int | None,
    method: str,
    snapshot_id: str | None,
    budget: int,
    seed: int,
    idempotency_key: str | None,
) -> Request:
    """Rank candidates."""
    if isinstance(candidates, Mapping):
        candidates = [Candidate(id=name, pose=pose) for name, pose in candidates.items()]
    request = RankingRequest(
        candidates=None if candidates is None else tuple(candidates),
        generator=generator,
        current_pose=current_pose,
        radius_m=radius_m,
        top_k=top_k,
        method=method,
        snapshot_id=snapshot_id,
        budget=budget,
        seed=seed,
    )
    path = f"/v1/scenes/{_part(scene_id)}/rankings"
    return _keyed(path, request, idempotency_key, _RANKING_TIMEOUT_S)


def get_ranking(ranking_id: str) -> Request:
    """Show a ranking."""
    return Request("GET", f"/v1/rankings/{_part(ranking_id)}")


def draw_candidate(ranking_id: str, candidate_id: str, picture: str) -> Request:
    """A PNG of what a candidate sees (``render``), or of its ``spectrum``."""
    path = f"/v1/rankings/{_part(ranking_id)}/candidates/{_part(candidate_id)}/{picture}.png"
    return Request("GET", path, read_timeout_s=_RANKING_TIMEOUT_S)


def snapshots_of(scene_id: str) -> str:
    """Where a scene's snapshots are listed."""
    return f"/v1/scenes/{_part(scene_id)}/snapshots"


def get_snapshot(snapshot_id: str) -> Request:
    """Show a snapshot."""
    return Request("GET", f"/v1/snapshots/{_part(snapshot_id)}")


def read_artifact(snapshot_id: str, name: str, start: int = 0, tag: str | None = None) -> Request:
    """A file of a snapshot, from byte ``start`` on if it is still the one that ``tag`` names."""
    headers: dict[str, str] = {"Accept-Encoding": "identity"}
    if start:
        headers["Range"] = f"bytes={start}-"
        if tag is not None:
            headers["If-Range"] = tag
    return Request("GET", f"/v1/snapshots/{_part(snapshot_id)}/artifacts/{_part(name)}", headers=headers)


def _keyed(
    path: str, content: Input, idempotency_key: str | None, read_timeout_s: float | None = None
) -> Request:
    """A POST that makes its resource once, however often it is sent."""
    return Request(
        "POST",
        path,
        headers={"Idempotency-Key": idempotency_key or uuid.uuid4().hex},
        document=content.document(),
        read_timeout_s=read_timeout_s,
    )


def _part(value: Any) -> str:
    """A segment of a path: an id cannot lead elsewhere."""
    return quote(str(value), safe=":@+~._-") if value not in (".", "..") else "%2E" * len(value)
