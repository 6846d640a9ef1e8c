"""Real scenes for the benchmarks: any COLMAP model with its photographs, as pinhole training views."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image
from scipy.ndimage import map_coordinates

from fvs_engine.geometry import PinholeCamera
from fvs_engine.geometry.cameras import Camera
from fvs_engine.images.pixels import load_rgb
from fvs_engine.sfm.colmap.model import read_colmap
from fvs_engine.splat.views import TrainingView

ZOOM = 1.01
"""How much an undistorted view is narrowed, so that no pixel falls outside the photograph."""
TEST_EVERY = 8


@dataclass(frozen=True)
class Scene:
    """Views sorted by name, and the sparse points with their colours."""

    views: tuple[TrainingView, ...]
    points: NDArray[np.float64]
    point_colors: NDArray[np.uint8]

    @property
    def training(self) -> tuple[TrainingView, ...]:
        """All but every eighth view."""
        return tuple(view for i, view in enumerate(self.views) if i % TEST_EVERY)

    @property
    def held_out(self) -> tuple[TrainingView, ...]:
        """Views 0, 8, 16, …, the usual split."""
        return self.views[::TEST_EVERY]


def load_scene(model_dir: Path, image_dir: Path, long_side_px: int, limit: int | None = None) -> Scene:
    """Read a COLMAP model and its photographs, undistorted and reduced to ``long_side_px``."""
    model = read_colmap(model_dir)
    posed = sorted(model.views, key=lambda view: view.name)[:limit]
    views = []
    maps: dict[Camera, tuple[PinholeCamera, NDArray[np.float64] | None]] = {}
    for view in posed:
        if view.camera not in maps:
            maps[view.camera] = _undistortion(view.camera)
        pinhole, where = maps[view.camera]
        image = _resample(load_rgb(image_dir / view.name), where)
        scale = min(1.0, long_side_px / max(pinhole.width, pinhole.height))
        size = (round(pinhole.width * scale), round(pinhole.height * scale))
        reduced = np.asarray(Image.fromarray(image).resize(size, Image.Resampling.BOX))
        views.append(TrainingView(view.name, pinhole.resized(*size), view.camera_from_model, reduced))
    return Scene(tuple(views), model.points.xyz, model.points.colors)


def _undistortion(camera: Camera) -> tuple[PinholeCamera, NDArray[np.float64] | None]:
    """A pinhole camera of the same size, and where its pixels lie in the photograph [H, W, 2] (y, x)."""
    if isinstance(camera, PinholeCamera):
        return camera, None
    pinhole = PinholeCamera(
        camera.width, camera.height, camera.fx * ZOOM, camera.fy * ZOOM, camera.cx, camera.cy
    )
    y, x = np.mgrid[: camera.height, : camera.width] + 0.5
    return pinhole, camera.project(pinhole.unproject(np.stack([x, y], axis=-1)))[..., ::-1] - 0.5


def _resample(image: NDArray[np.uint8], where: NDArray[np.float64] | None) -> NDArray[np.uint8]:
    if where is None:
        return image
    y, x = where[..., 0], where[..., 1]
    channels: Sequence[NDArray[np.float32]] = [
        map_coordinates(image[..., c].astype(np.float32), [y, x], order=1, mode="nearest") for c in range(3)
    ]
    return np.stack(channels, axis=-1).round().clip(0, 255).astype(np.uint8)
