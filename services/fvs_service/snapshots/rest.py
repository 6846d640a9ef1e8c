"""Snapshots over REST, with ranges of artifacts."""

from typing import Annotated

from fastapi import Depends, Path
from fastapi.responses import Response

from fvs_schema.snapshots import Snapshot, SnapshotChange, SnapshotList
from fvs_service.gateway.rest.bodies import json_body
from fvs_service.gateway.rest.conditions import IfNoneMatch
from fvs_service.gateway.rest.dependencies import (
    App,
    Caller,
    Paging,
    SceneId,
    SnapshotId,
    to_operate_snapshot,
)
from fvs_service.gateway.rest.ranges import IfRange, RangeHeader, ranged_response
from fvs_service.gateway.rest.routing import json_router
from fvs_service.snapshots.artifacts import MEDIA_TYPES

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
    """List the snapshots of a scene, the newest first."""
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
    change: Annotated[SnapshotChange, Depends(json_body(SnapshotChange, to_operate_snapshot))],
) -> Snapshot:
    """Pin a snapshot, so that retention keeps it, or unpin it."""
    return app.storage.snapshots.change(caller, snapshot_id, change)


@router.delete("/snapshots/{snapshot_id}", status_code=204)
def delete_snapshot(app: App, caller: Caller, snapshot_id: SnapshotId) -> None:
    """Delete a snapshot that is neither its scene's current one nor pinned; its rankings stay."""
    app.deletions.snapshot(caller, snapshot_id)


@router.get("/snapshots/{snapshot_id}/artifacts/{name}", response_class=Response, responses=_RANGES)  # type: ignore[arg-type]
def download_artifact(
    app: App,
    caller: Caller,
    snapshot_id: SnapshotId,
    name: Annotated[
        str, Path(max_length=64, description="The artifact's name.", examples=["point_cloud.ply"])
    ],
    range_header: RangeHeader = None,
    if_range: IfRange = None,
    if_none_match: IfNoneMatch = None,
) -> Response:
    """Download an artifact or a range of it; with `If-Range` an interrupted download resumes safely."""
    snapshot = app.storage.snapshots.get(caller, snapshot_id)
    artifact = app.storage.snapshots.artifact(caller, snapshot_id, name)
    return ranged_response(
        artifact.sha256,
        artifact.size_bytes,
        artifact.media_type,
        lambda start, stop: app.storage.snapshots.read(snapshot, name, start, stop),
        range_header=range_header,
        if_range=if_range,
        if_none_match=if_none_match,
    )
