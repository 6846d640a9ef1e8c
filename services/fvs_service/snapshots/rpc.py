"""Snapshots over gRPC."""

from collections.abc import AsyncIterator

from anyio.to_thread import run_sync
from fvs.v1 import snapshots_pb2 as pb
from fvs.v1.downloads_pb2 import DownloadPart

from fvs_schema.base import Page
from fvs_schema.snapshots import Snapshot, SnapshotChange, SnapshotList
from fvs_service.application import Application
from fvs_service.gateway.rpc.calls import Call
from fvs_service.gateway.rpc.conversion import pick, read
from fvs_service.gateway.rpc.downloads import download
from fvs_service.principal import Principal, Scope


class SnapshotServicer:
    """``fvs.v1.SnapshotService``."""

    service = pb.DESCRIPTOR.services_by_name["SnapshotService"]

    def __init__(self, app: Application) -> None:
        self._app = app
        self._snapshots = app.storage.snapshots

    def list_snapshots(self, caller: Principal, request: pb.ListSnapshotsRequest) -> SnapshotList:
        """List the snapshots of a scene."""
        page = pick(Page, request)
        return self._snapshots.of_scene(caller, request.scene_id, page)

    def get_snapshot(self, caller: Principal, request: pb.GetSnapshotRequest) -> Snapshot:
        """Return a snapshot."""
        return self._snapshots.get(caller, request.snapshot_id)

    def change_snapshot(self, caller: Principal, request: pb.ChangeSnapshotRequest) -> Snapshot:
        """Pin or unpin a snapshot."""
        self._snapshots.require(caller, Scope.OPERATE, request.snapshot_id)
        return self._snapshots.change(caller, request.snapshot_id, read(SnapshotChange, request.change))

    def delete_snapshot(self, caller: Principal, request: pb.DeleteSnapshotRequest) -> None:
        """Delete a snapshot."""
        self._app.deletions.snapshot(caller, request.snapshot_id)

    async def download_artifact(
        self, _call: Call, caller: Principal, request: pb.DownloadArtifactRequest
    ) -> AsyncIterator[DownloadPart]:
        """Stream an artifact or a range of it."""
        snapshot = await run_sync(self._snapshots.get, caller, request.snapshot_id)
        artifact = await run_sync(self._snapshots.artifact, caller, request.snapshot_id, request.name)
        async for part in download(
            request,
            artifact.media_type,
            artifact.size_bytes,
            artifact.sha256,
            lambda start, stop: self._snapshots.read(snapshot, request.name, start, stop),
        ):
            yield part
