# Generated from _async/snapshots.py by `make generate`. Do not edit.
"""Snapshots and their artifacts."""

from collections.abc import Callable, Iterator
from os import PathLike
from pathlib import Path
from typing import Self

from fvs_client import requests
from fvs_client._sync import downloading
from fvs_client._sync.session import Resource, Session
from fvs_client.answers import parse
from fvs_client.downloads import DownloadProgress, artifact_named, target_path
from fvs_client.models.display import Jpeg, Png
from fvs_client.models.resources import SceneData, SnapshotData
from fvs_schema.poses import FramePose, VehiclePose
from fvs_schema.renders import RenderFormat, RenderRequest, ViewImage
from fvs_schema.snapshots import SnapshotCameras


class Snapshot(Resource, SnapshotData):
    """An immutable model and its artifacts."""

    def download(
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
        return downloading.download(
            self._session, requests.artifact_of(self.id, name), artifact, target, on_progress
        )

    def pin(self) -> Self:
        """Pin the snapshot, so that retention never deletes it."""
        return self._session.fetch(type(self), requests.change_snapshot(self.id, pinned=True))

    def unpin(self) -> Self:
        """Unpin the snapshot, so that retention may delete it."""
        return self._session.fetch(type(self), requests.change_snapshot(self.id, pinned=False))

    def delete(self) -> None:
        """Delete the snapshot; raises ``ConflictError`` for the scene's current one and a pinned one."""
        self._session.content(requests.delete_snapshot(self.id))

    def render(
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
        content = self._session.content(requests.render_view(self.id, request))
        return Png(content) if request.format is RenderFormat.PNG else Jpeg(content)

    def cameras(self) -> SnapshotCameras:
        """The cameras of the registered images, in the model's frame."""
        artifact = artifact_named(self, "cameras.json")
        path = requests.artifact_of(self.id, artifact.name)
        content = downloading.read(self._session, path, artifact)
        return parse(SnapshotCameras, content)


class Snapshots:
    """Snapshots by id."""

    def __init__(self, session: Session) -> None:
        self._session = session

    def get(self, snapshot_id: str) -> Snapshot:
        """Get a snapshot."""
        return self._session.fetch(Snapshot, requests.get_snapshot(snapshot_id))


class SceneSnapshots:
    """The snapshots of a scene."""

    def __init__(self, session: Session, scene_id: str) -> None:
        self._session, self._scene_id = session, scene_id

    def latest(self) -> Snapshot | None:
        """Get the latest snapshot; None when the scene has no model."""
        scene = self._session.fetch(SceneData, requests.get_scene(self._scene_id))
        if scene.snapshot_id is None:
            return None
        return self._session.fetch(Snapshot, requests.get_snapshot(scene.snapshot_id))

    def list(self) -> Iterator[Snapshot]:
        """All snapshots, newest first."""
        return self._session.items(Snapshot, requests.snapshots_of(self._scene_id))
