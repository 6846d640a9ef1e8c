from collections.abc import Callable

import numpy as np
import pytest
import torch
from scipy.spatial.transform import Rotation

from fvs_engine.geometry import PinholeCamera, RigidTransform, SimilarityTransform, look_at
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.moved import moved
from fvs_engine.splat.raster.selection import create_rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.views import PinholeView

Make = Callable[..., Gaussians]
CAMERA = PinholeCamera(96, 64, 80.0, 80.0, 48.0, 32.0)
WORLD_FROM_MODEL = SimilarityTransform(
    37.5, Rotation.from_euler("zyx", [140, 35, -70], degrees=True).as_matrix(), np.array([120.0, -45.0, 8.0])
)


@pytest.mark.parametrize("sh_degree", [0, 1, 2, 3])
def test_a_moved_camera_sees_the_same_picture(make_gaussians: Make, sh_degree: int) -> None:
    model = make_gaussians(300, sh_degree)
    model.sh_rest *= 5.0
    model_from_camera = look_at([2.5, 1.0, -3.0], [0.0, 0.0, 0.0], [0.2, 1.0, 0.1])
    rasterizer = create_rasterizer("reference")
    before = render_color(model, _view(model_from_camera), rasterizer, sh_degree=3)
    world_from_camera = WORLD_FROM_MODEL.move_camera(model_from_camera)
    after = render_color(moved(model, WORLD_FROM_MODEL), _view(world_from_camera), rasterizer, sh_degree=3)
    assert before.std() > 0.1
    np.testing.assert_allclose(after, before, atol=1e-4)


def test_harmonics_that_stay_show_other_colours(make_gaussians: Make) -> None:
    model = make_gaussians(300, 3)
    model.sh_rest *= 5.0
    camera = look_at([2.5, 1.0, -3.0], [0.0, 0.0, 0.0], [0.2, 1.0, 0.1])
    rasterizer = create_rasterizer("reference")
    turned = moved(model, WORLD_FROM_MODEL)
    turned.sh_rest = model.sh_rest
    before = render_color(model, _view(camera), rasterizer, sh_degree=3)
    after = render_color(turned, _view(WORLD_FROM_MODEL.move_camera(camera)), rasterizer, sh_degree=3)
    assert np.abs(after - before).mean() > 0.05


def test_there_and_back_is_the_same_model(make_gaussians: Make) -> None:
    model = make_gaussians(50, 3)
    again = moved(moved(model, WORLD_FROM_MODEL), WORLD_FROM_MODEL.inverse())
    for name, tensor in model.tensors().items():
        torch.testing.assert_close(again.tensors()[name], tensor, atol=1e-5, rtol=1e-5)


def _view(frame_from_camera: RigidTransform) -> PinholeView:
    return PinholeView("view", CAMERA, frame_from_camera.inverse())
