"""The views of an output folder: pinhole cameras at training resolution, and which are held out."""

from collections.abc import Sequence
from pathlib import Path

from fvs_engine.errors import StorageError, TrainingError
from fvs_engine.geometry import PinholeCamera
from fvs_engine.images.pixels import load_rgb, reduced_size
from fvs_engine.monitor import Monitor
from fvs_engine.pipeline.workspace import Workspace
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.sfm.reconstruction import Reconstruction
from fvs_engine.splat.views import TrainingView
from fvs_engine.views import PinholeView
from fvs_schema.stages import Stage


def read_undistorted(workspace: Workspace) -> Reconstruction:
    """The pinhole model of the folder; raises ``StorageError`` when it is damaged."""
    return read_colmap(workspace.undistorted / "sparse")


def model_views(reconstruction: Reconstruction, long_side_px: int) -> tuple[PinholeView, ...]:
    """The views sorted by name, their cameras reduced to ``long_side_px``."""
    views = []
    for view in sorted(reconstruction.views, key=lambda view: view.name):
        camera = view.camera
        if not isinstance(camera, PinholeCamera):
            raise StorageError(
                f"The camera of {view.name} still has distortion.",
                hint="Start again with --overwrite.",
            )
        reduced = camera.resized(*reduced_size(camera.width, camera.height, long_side_px))
        views.append(PinholeView(view.name, reduced, view.camera_from_model))
    return tuple(views)


def load_views(
    views: Sequence[PinholeView], image_dir: Path, long_side_px: int, monitor: Monitor
) -> list[TrainingView]:
    """Read the photographs of ``views`` from ``image_dir`` at training resolution. Stage ``load``."""
    loaded = []
    for done, view in enumerate(views, start=1):
        image = load_rgb(image_dir / view.name, long_side_px)
        if image.shape[:2] != (view.camera.height, view.camera.width):
            raise TrainingError(
                f"{image_dir / view.name} has {image.shape[1]}×{image.shape[0]} px, "
                f"its camera {view.camera.width}×{view.camera.height} px.",
                hint="The cameras belong to other images: give the images that they were computed from.",
            )
        loaded.append(TrainingView(view.name, view.camera, view.camera_from_model, image))
        monitor.report(Stage.LOAD, done, len(views))
        monitor.check()
    return loaded
