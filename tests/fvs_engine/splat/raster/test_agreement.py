"""Every backend is held to the reference in float64: images and gradients, on scenes made to break them."""

import pytest
import torch

from fvs_engine.splat.raster import Rasterizer, Rendering, create_rasterizer
from fvs_engine.splat.raster.reference import ReferenceRasterizer


@pytest.fixture(
    params=[
        "reference",
        "cpu",
        *(pytest.param(name, marks=pytest.mark.cuda) for name in ("gsplat", "triton")),
    ]
)
def rasterizer(request):
    return create_rasterizer(request.param)


def _render(rasterizer: Rasterizer, gaussians, scene) -> Rendering:
    return rasterizer.render(gaussians, scene.camera, scene.camera_from_model)


@pytest.mark.parametrize("differentiable", [False, True], ids=["without gradients", "with gradients"])
def test_images_agree(rasterizer, scene, differentiable):
    with torch.no_grad():
        expected = _render(ReferenceRasterizer(), scene.copy(torch.float64), scene)
    with torch.set_grad_enabled(differentiable):
        actual = _render(rasterizer, scene.copy(device=str(rasterizer.device)), scene)
    for name in ("color", "alpha"):
        difference = (getattr(actual, name).detach().cpu() - getattr(expected, name)).abs()
        assert difference[scene.decided].max() <= 1e-4, name
    depth_scale = max(1.0, float(expected.depth.max()))
    assert (actual.depth.detach().cpu() - expected.depth).abs()[scene.decided].max() <= 1e-4 * depth_scale
    assert torch.equal(actual.radii_px.cpu() > 0, expected.radii_px > 0)


@pytest.mark.parametrize("with_depth", [True, False], ids=["all images", "colour only"])
def test_gradients_agree(rasterizer, scene, with_depth):
    weights = torch.randn(
        scene.camera.height, scene.camera.width, 5, generator=torch.Generator().manual_seed(3)
    )
    weights = (weights * scene.decided[..., None]).double()

    def gradients(backend, gaussians):
        rendering = _render(backend, gaussians, scene)
        w = weights.to(rendering.color)
        loss = (rendering.color * w[..., :3]).sum()
        if with_depth:
            loss = loss + (rendering.alpha * w[..., 3]).sum() + (rendering.depth * w[..., 4]).sum()
        loss.backward()
        tensors = gaussians.tensors()
        # A backend may leave out the gradient of what it did not read.
        found = {name: torch.zeros_like(t) if t.grad is None else t.grad for name, t in tensors.items()}
        found["screen_means"] = rendering.screen_means.grad
        return {name: grad.double().cpu() for name, grad in found.items()}

    expected = gradients(ReferenceRasterizer(), scene.copy(torch.float64))
    actual = gradients(rasterizer, scene.copy(device=str(rasterizer.device)))
    for name, grad in expected.items():
        if grad.numel() == 0:
            assert actual[name].shape == grad.shape
            continue
        assert (actual[name] - grad).abs().max() <= 1e-3 * grad.abs().max(), name


def test_lower_sh_degree_ignores_the_rest(rasterizer, scene):
    full = scene.copy(device=str(rasterizer.device)).requires_grad_(False)
    low = scene.copy(device=str(rasterizer.device)).requires_grad_(False)
    low.sh_rest[:, 3:] = 0
    with torch.no_grad():
        one = rasterizer.render(full, scene.camera, scene.camera_from_model, sh_degree=1)
        same = rasterizer.render(low, scene.camera, scene.camera_from_model, sh_degree=3)
    assert torch.allclose(one.color, same.color, atol=1e-6)
