"""The trained model of an output folder."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from fvs_engine.errors import InvalidInputError, StorageError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.images.pixels import reduced_size
from fvs_engine.pipeline.manifest import CamerasRecord, Manifest, Position
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.plan.familiarity import Observations
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.scene.sparse_points import read_observations
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.splat.ply import read_ply
from fvs_engine.views import PinholeView, with_share


@dataclass(frozen=True, eq=False, kw_only=True)
class FolderModel(SceneModel):
    """The model of an output folder, on the CPU; its views are named as in ``images/``."""

    workspace: Workspace
    manifest: Manifest

    @property
    def origin(self) -> NDArray[np.float64]:
        """The zero of the model frame in the coordinates of the imported cameras [3]."""
        cameras = self.manifest.cameras
        return np.zeros(3) if cameras is None else np.array(cameras.origin)

    def in_user_frame(self, position: Position) -> Position:
        """A position of the model frame in the coordinates of the imported cameras."""
        x, y, z = (position + self.origin).tolist()
        return x, y, z

    @property
    def aliases(self) -> Mapping[str, str]:
        """A photograph's name in the source folder → its name in the model."""
        return {record.name: record.normalised_name for record in self.manifest.images.photographs}


def open_model(root: Path) -> FolderModel:
    """Read the last good state of an output folder, also during a training in it.

    Raises ``InvalidInputError`` when it is not an output folder or has no trained model yet.
    """
    workspace = Workspace.existing(root)
    manifest = workspace.read_manifest()
    if manifest is None or manifest.training is None:
        raise InvalidInputError(
            f"{root} holds no trained model yet.",
            hint="Run the same `fvs reconstruct` again to go on.",
            path=root,
        )
    training, cameras = manifest.training, manifest.cameras
    views = model_views(read_undistorted(workspace), manifest.settings.training_long_side_px)
    gaussians = read_ply(workspace.point_cloud)
    return FolderModel(
        gaussians=gaussians,
        sh_degree=gaussians.sh_degree,
        iterations=training.iterations,
        views=tuple(
            with_share(view, training.counted_shares.get(view.name, 1.0))
            for view in views
            if view.name in training.train_views
        ),
        held_out=tuple(view for view in views if view.name in training.test_views),
        read_observations=lambda: _observations(workspace, cameras),
        workspace=workspace,
        manifest=manifest,
    )


def _observations(workspace: Workspace, cameras: CamerasRecord | None) -> Observations | None:
    """The sparse points and who saw them; None where the poses of photographs are given."""
    if cameras is None or cameras.source != "photographs":
        return None
    return read_observations(workspace.undistorted / "sparse")


def read_undistorted(workspace: Workspace) -> Reconstruction:
    """The pinhole model of the folder; raises ``StorageError`` when it is damaged."""
    return read_colmap(workspace.undistorted / "sparse")


def model_views(reconstruction: Reconstruction, long_side_px: int) -> tuple[PinholeView, ...]:
    """The views sorted by name, their cameras reduced to ``long_side_px``."""
    return tuple(
        replace(
            view,
            camera=view.camera.resized(*reduced_size(view.camera.width, view.camera.height, long_side_px)),
        )
        for view in full_size_views(reconstruction)
    )


def full_size_views(reconstruction: Reconstruction) -> tuple[PinholeView, ...]:
    """The views sorted by name; raises ``StorageError`` when one still has distortion."""
    views = []
    for view in sorted(reconstruction.views, key=lambda view: view.name):
        if not isinstance(view.camera, PinholeCamera):
            raise StorageError(
                f"The camera of {view.name} still has distortion.",
                hint="Start again with --overwrite.",
            )
        views.append(PinholeView(view.name, view.camera, view.camera_from_model))
    return tuple(views)
