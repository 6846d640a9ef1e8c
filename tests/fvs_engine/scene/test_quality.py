from dataclasses import replace

import numpy as np
import pytest
import torch

from fvs_engine.geometry import PinholeCamera, look_at
from fvs_engine.monitor import Monitor
from fvs_engine.scene.quality import evenly_spaced, measure
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.views import TrainingView


@pytest.fixture
def rasterizer() -> Rasterizer:
    return create_rasterizer("reference")


@pytest.fixture
def blob() -> Gaussians:
    generator = torch.Generator().manual_seed(3)
    return Gaussians(
        means=torch.randn((30, 3), generator=generator) * 0.4,
        log_scales=torch.full((30, 3), -1.5),
        quaternions_wxyz=torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(30, 1),
        opacity_logits=torch.full((30,), 2.0),
        sh_dc=torch.randn((30, 3), generator=generator),
        sh_rest=torch.zeros((30, 0, 3)),
    )


def _views(gaussians: Gaussians, rasterizer: Rasterizer, count: int) -> list[TrainingView]:
    camera = PinholeCamera(32, 24, 30, 30, 16, 12)
    views = []
    for number in range(count):
        angle = 2 * np.pi * number / count
        pose = look_at([3 * np.cos(angle), 3 * np.sin(angle), 1.0], [0, 0, 0], [0, 0, 1]).inverse()
        color = rasterizer.render(gaussians, camera, pose, sh_degree=0).color.clamp(0, 1).numpy()
        views.append(TrainingView(f"{number}.png", camera, pose, np.round(color * 255).astype(np.uint8)))
    return views


def _model(gaussians: Gaussians) -> SceneModel:
    return SceneModel(gaussians=gaussians, sh_degree=0, iterations=0)


def test_a_model_renders_its_own_images_best(blob: Gaussians, rasterizer: Rasterizer) -> None:
    views = _views(blob, rasterizer, 3)
    own = measure(_model(blob), views, rasterizer, Monitor())
    assert own is not None
    assert own.psnr_db > 50
    assert own.ssim > 0.99
    other = measure(_model(replace(blob, sh_dc=-blob.sh_dc)), views, rasterizer, Monitor())
    assert other is not None
    assert other.psnr_db < 30
    assert other.ssim < own.ssim
    assert measure(_model(blob), [], rasterizer, Monitor()) is None


def test_views_are_measured_all_over(blob: Gaussians, rasterizer: Rasterizer) -> None:
    views = _views(blob, rasterizer, 9)
    assert [view.name for view in evenly_spaced(views, 3)] == ["0.png", "4.png", "8.png"]
    assert evenly_spaced(views, 9) == views


def test_quality_is_measured_where_photographs_count(blob: Gaussians, rasterizer: Rasterizer) -> None:
    views = _views(blob, rasterizer, 3)
    right = np.tile(np.arange(32) >= 16, (24, 1))
    covered = [
        replace(view, image=np.where(right[..., None], view.image, np.uint8(255)), mask=right)
        for view in views
    ]
    nowhere = replace(views[0], image=255 - views[0].image, mask=np.zeros_like(right))
    found = measure(_model(blob), [*covered, nowhere], rasterizer, Monitor())
    assert found is not None
    assert found.psnr_db > 50
    assert found.ssim > 0.99
    assert measure(_model(blob), [nowhere], rasterizer, Monitor()) is None
