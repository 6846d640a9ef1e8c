"""Snapshots over REST, with ranges of artifacts."""

from typing import Annotated

from fastapi import Depends, Header, Path
from fastapi.responses import Response, StreamingResponse

from fvs_service.errors import RangeError
from fvs_service.gateway.rest.bodies import json_body
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    Paging,
    SceneId,
    SnapshotId,
    snapshot_operator,
)
from fvs_service.gateway.rest.routing import json_router
from fvs_service.snapshots.model import MEDIA_TYPES, Artifact, Snapshot, SnapshotChange, SnapshotList

router = json_router("/v1", "snapshots")

_BINARY = {"schema": {"type": "string", "format": "binary"}}
_BYTES = {"content": {kind: {} if kind == "application/json" else _BINARY for kind in MEDIA_TYPES.values()}}
_RANGES = {
    200: {"description": "The whole artifact.", **_BYTES},
    206: {"description": "The requested range.", **_BYTES},
    304: {"description": "The artifact is the one that `If-None-Match` names."},
}


@router.get("/scenes/{scene_id}/snapshots")
def list_snapshots(app: App, caller: Caller, scene_id: SceneId, page: Paging) -> SnapshotList:
    """List the snapshots of a scene, the oldest first."""
    return app.storage.snapshots.of_scene(caller, scene_id, page)


@router.get("/snapshots/{snapshot_id}")
def get_snapshot(app: App, caller: Caller, snapshot_id: SnapshotId) -> Snapshot:
    """Return a snapshot with the list of its artifacts."""
    return app.storage.snapshots.get(caller, snapshot_id)


@router.patch("/snapshots/{snapshot_id}")
def change_snapshot(
    app: App,
    caller: Caller,
    snapshot_id: SnapshotId,
    change: Annotated[SnapshotChange, Depends(json_body(SnapshotChange, snapshot_operator))],
) -> Snapshot:
    """Pin a snapshot, so that retention keeps it, or unpin it."""
    return app.storage.snapshots.change(caller, snapshot_id, change)


@router.delete("/snapshots/{snapshot_id}", status_code=204)
def delete_snapshot(app: App, caller: Caller, snapshot_id: SnapshotId) -> None:
    """Delete a snapshot that is neither its scene's current one nor pinned; its rankings stay."""
    app.deletions.snapshot(caller, snapshot_id)


@router.head("/snapshots/{snapshot_id}/artifacts/{name}", include_in_schema=False)
@router.get("/snapshots/{snapshot_id}/artifacts/{name}", response_class=Response, responses=_RANGES)  # type: ignore[arg-type]
def read_artifact(
    app: App,
    caller: Caller,
    snapshot_id: SnapshotId,
    name: Annotated[str, Path(max_length=64, examples=["point_cloud.ply"])],
    range_header: Annotated[str | None, Header(alias="Range", examples=["bytes=0-1023"])] = None,
    if_range: Annotated[str | None, Header()] = None,
    if_none_match: Annotated[str | None, Header()] = None,
) -> Response:
    """Download an artifact or a range of it; with `If-Range` an interrupted download resumes safely."""
    snapshot = app.storage.snapshots.get(caller, snapshot_id)
    artifact = app.storage.snapshots.artifact(caller, snapshot_id, name)
    headers = {"ETag": _tag(artifact), "Accept-Ranges": "bytes"}
    if if_none_match is not None and headers["ETag"] in if_none_match:
        return Response(status_code=304, headers=headers)
    span = byte_range(range_header, artifact.size_bytes) if if_range in (None, headers["ETag"]) else None
    start, stop = span or (0, artifact.size_bytes)
    headers["Content-Length"] = str(stop - start)
    if span is not None:
        headers["Content-Range"] = f"bytes {start}-{stop - 1}/{artifact.size_bytes}"
    content = app.storage.snapshots.read(snapshot, name, start, stop)
    return StreamingResponse(content, 200 if span is None else 206, headers, artifact.media_type)


def byte_range(header: str | None, size: int) -> tuple[int, int] | None:
    """The first byte and the one after the last of a ``Range`` header; None for the whole artifact.

    Headers that are not a single range of bytes are ignored, as RFC 9110 (section 14.2) allows. Raises
    ``RangeError`` for a range that starts after the end.
    """
    unit, _, spec = (header or "").partition("=")
    first, dash, last = spec.strip().partition("-")
    if unit.strip() != "bytes" or not dash or not all(_is_number(part) for part in (first, last) if part):
        return None
    if not first:
        if not last:
            return None
        start, stop = max(0, size - int(last)), size
    else:
        start, stop = int(first), min(size, int(last) + 1) if last else size
        if last and int(last) < start:
            return None
    if start >= size or stop <= start:
        raise RangeError(size)
    return start, stop


def _is_number(text: str) -> bool:
    return text.isascii() and text.isdigit() and len(text) < 19


def _tag(artifact: Artifact) -> str:
    return f'"{artifact.sha256}"'
