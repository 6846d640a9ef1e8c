"""A synthetic dataset: photographs of a known model from a circle of cameras, points with their tracks."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from PIL import Image

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.scene.dataset import Dataset
from fvs_engine.scene.settings import SCENE_TRAINING, SceneSettings
from fvs_engine.scene.sparse_points import SparsePoints
from fvs_engine.sfm.reconstruction import PointCloud
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.views import View

VIEWS = 10
POINTS = 200


@pytest.fixture(scope="session")
def cpu() -> Rasterizer:
    return create_rasterizer("cpu")


@pytest.fixture(scope="session")
def ball(tmp_path_factory: pytest.TempPathFactory, cpu: Rasterizer) -> Dataset:
    """Ten 48 × 40 px photographs of 200 Gaussians; a view sees the points of its half of the ball."""
    draw = torch.Generator().manual_seed(5)
    model = Gaussians(
        means=0.7 * torch.randn((POINTS, 3), generator=draw),
        log_scales=-2.0 + 0.3 * torch.randn((POINTS, 3), generator=draw),
        quaternions_wxyz=torch.randn((POINTS, 4), generator=draw),
        opacity_logits=1.0 + torch.randn(POINTS, generator=draw),
        sh_dc=torch.randn((POINTS, 3), generator=draw),
        sh_rest=torch.zeros(POINTS, 0, 3),
    )
    folder = tmp_path_factory.mktemp("ball")
    camera = PinholeCamera(48, 40, 50.0, 50.0, 24.0, 20.0)
    points = model.means.numpy().astype(np.float64)
    views, tracks = [], []
    for i in range(VIEWS):
        angle = 2 * np.pi * i / VIEWS
        rotation = np.array(
            [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
        )
        view = View(f"{i}.png", camera, RigidTransform(rotation, np.array([0.0, 0.0, 4.0])))
        color = cpu.render(model, camera, view.camera_from_model).color.clamp(0, 1).numpy()
        Image.fromarray((color * 255).round().astype(np.uint8)).save(folder / view.name)
        seen = np.flatnonzero(points @ view.centre > 0)
        tracks.append(np.stack([np.full(len(seen), i), seen], axis=1))
        views.append(view)
    pairs = np.concatenate(tracks)
    cloud = PointCloud(points, np.full((POINTS, 3), 128, np.uint8))
    names = tuple(view.name for view in views)
    return Dataset("ball", folder, tuple(views), SparsePoints(cloud, names, pairs[:, 0], pairs[:, 1]))


@pytest.fixture(scope="session")
def quick_settings() -> Callable[..., SceneSettings]:
    """A factory of settings with known poses, 20 iterations and 4 more per view; keywords override them."""

    def build(**changes: object) -> SceneSettings:
        densification = SCENE_TRAINING.densification.model_copy(update={"first_iteration": 5, "interval": 10})
        training = SCENE_TRAINING.model_copy(update={"densification": densification})
        settings = SceneSettings(
            poses="known", long_side_px=48, initial_iterations=20, iterations_per_view=4, training=training
        )
        return settings.model_copy(update=changes)

    return build
