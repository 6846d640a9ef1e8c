"""A tiny scene whose photographs are renderings of a known model: what training must be able to recover."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from random_gaussians import random_gaussians

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.initialise import initialise_from_points
from fvs_engine.splat.raster.selection import create_rasterizer
from fvs_engine.splat.views import TrainingView


@pytest.fixture
def make_gaussians() -> Callable[..., Gaussians]:
    """Builds random Gaussians around the origin: (count, sh_degree, seed=0)."""
    return random_gaussians


@pytest.fixture(scope="session")
def scene_views() -> tuple[TrainingView, ...]:
    """Eight 48 × 40 px views, from a circle around the origin, of 150 random Gaussians."""
    model = random_gaussians(150, 0, seed=5)
    camera = PinholeCamera(48, 40, 50.0, 50.0, 24.0, 20.0)
    rasterizer = create_rasterizer("cpu")
    views = []
    for i in range(8):
        angle = 2 * np.pi * i / 8
        rotation = np.array(
            [[np.cos(angle), 0, -np.sin(angle)], [0, 1, 0], [np.sin(angle), 0, np.cos(angle)]]
        )
        camera_from_model = RigidTransform(rotation, np.array([0.0, 0.0, 4.0]))
        color = rasterizer.render(model, camera, camera_from_model).color
        image = (color.clamp(0, 1) * 255).round().to(torch.uint8).numpy()
        views.append(TrainingView(f"{i}.png", camera, camera_from_model, image))
    return tuple(views)


@pytest.fixture
def start() -> Callable[[int], Gaussians]:
    """Builds what sparse points give: the right places, roughly, and the wrong colours."""

    def build(sh_degree: int) -> Gaussians:
        points = random_gaussians(150, 0, seed=5).means.numpy().astype(np.float64)
        return initialise_from_points(points[::2], np.full((75, 3), 128, np.uint8), sh_degree)

    return build
