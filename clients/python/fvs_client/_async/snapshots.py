"""Snapshots and their artifacts."""

from collections.abc import AsyncIterator, Callable
from os import PathLike
from pathlib import Path
from typing import Self

from fvs_client import requests
from fvs_client._async import downloading
from fvs_client._async.session import AsyncResource, AsyncSession
from fvs_client.answers import parse
from fvs_client.downloads import DownloadProgress, artifact_named, target_path
from fvs_client.models.display import Jpeg, Png
from fvs_client.models.resources import SceneData, SnapshotData
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.renders import RenderFormat, RenderRequest, ViewImage
from fvs_schema.snapshots import SnapshotCameras


class AsyncSnapshot(AsyncResource, SnapshotData):
    """An immutable model and its artifacts."""

    async def download(
        self,
        name: str,
        path: str | PathLike[str] = ".",
        *,
        on_progress: Callable[[DownloadProgress], object] | None = None,
    ) -> Path:
        """Write the artifact ``name`` to ``path`` (or into that folder), verified; return where it is.

        An interrupted download resumes where it ended. Raises ``DamagedDownloadError``.
        """
        artifact, target = artifact_named(self, name), target_path(path, name)
        return await downloading.download(
            self._session, requests.artifact_of(self.id, name), artifact, target, on_progress
        )

    async def pin(self) -> Self:
        """Pin the snapshot, so that retention never deletes it."""
        return await self._session.fetch(type(self), requests.change_snapshot(self.id, pinned=True))

    async def unpin(self) -> Self:
        """Unpin the snapshot, so that retention may delete it."""
        return await self._session.fetch(type(self), requests.change_snapshot(self.id, pinned=False))

    async def delete(self) -> None:
        """Delete the snapshot; raises ``ConflictError`` for the scene's current one and a pinned one."""
        await self._session.content(requests.delete_snapshot(self.id))

    async def render(
        self,
        pose: FramePose | VehiclePose,
        *,
        image: ViewImage | str = ViewImage.RENDER,
        long_side_px: int | None = None,
        format: RenderFormat | str = RenderFormat.PNG,  # noqa: A002
    ) -> Png | Jpeg:
        """Get what the model shows from ``pose``, or the spectrum of it; a notebook shows it.

        ``long_side_px``, from 64 to 4,096, is by default that of ``cameras().camera``. Raises
        ``InvalidRequestError`` for a pose of a vehicle where the scene is not georeferenced.
        """
        request = RenderRequest(
            pose=pose, image=ViewImage(image), long_side_px=long_side_px, format=RenderFormat(format)
        )
        content = await self._session.content(requests.render_view(self.id, request))
        return Png(content) if request.format is RenderFormat.PNG else Jpeg(content)

    async def cameras(self) -> SnapshotCameras:
        """The cameras of the registered images, in the model's frame."""
        artifact = artifact_named(self, "cameras.json")
        path = requests.artifact_of(self.id, artifact.name)
        content = await downloading.read(self._session, path, artifact)
        return parse(SnapshotCameras, content)


class AsyncSnapshots:
    """Snapshots by id."""

    def __init__(self, session: AsyncSession) -> None:
        self._session = session

    async def get(self, snapshot_id: str) -> AsyncSnapshot:
        """Get a snapshot."""
        return await self._session.fetch(AsyncSnapshot, requests.get_snapshot(snapshot_id))


class AsyncSceneSnapshots:
    """The snapshots of a scene."""

    def __init__(self, session: AsyncSession, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    async def latest(self) -> AsyncSnapshot | None:
        """Get the latest snapshot; None when the scene has no model."""
        scene = await self._session.fetch(SceneData, requests.get_scene(self._scene_id))
        if scene.snapshot_id is None:
            return None
        return await self._session.fetch(AsyncSnapshot, requests.get_snapshot(scene.snapshot_id))

    def list(self) -> AsyncIterator[AsyncSnapshot]:
        """All snapshots, newest first."""
        return self._session.items(AsyncSnapshot, requests.snapshots_of(self._scene_id))
