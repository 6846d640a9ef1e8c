"""The adapter to gsplat without a GPU, held to the reference in float64.

In float32 the inverse of the screen covariance, which gsplat keeps,
costs needles digits: up to 2e-4 of colour.
"""

import numpy as np
import pytest
import torch

from fvs_engine.errors import BackendUnavailableError
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.densification import GradientStatistics
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.raster.reference import ReferenceRasterizer


def _rendered(rasterizer, scene):
    """What a backend makes of a scene in float64, and every gradient of a loss over all that it returns."""
    gaussians = scene.copy(torch.float64)
    rendering = rasterizer.render(gaussians, scene.camera, scene.camera_from_model)
    draw = torch.Generator().manual_seed(3)
    weights = torch.randn(*rendering.alpha.shape, 5, generator=draw).double() * scene.decided[..., None]
    values = torch.cat([rendering.color, rendering.alpha[..., None], rendering.depth[..., None]], dim=-1)
    (values * weights).sum().backward()
    # A backend may leave out the gradient of what it did not read.
    found = {
        name: torch.zeros_like(tensor) if tensor.grad is None else tensor.grad
        for name, tensor in gaussians.tensors().items()
    }
    return rendering, {**found, "screen_means": rendering.screen_means.grad}


def _counted(rendering):
    statistics = GradientStatistics(len(rendering.radii_px), torch.device("cpu"))
    statistics.total, statistics.views = statistics.total.double(), statistics.views.double()
    statistics.add(rendering)
    return statistics


@pytest.mark.system
def test_all_that_training_reads_is_as_in_the_reference(gsplat_in_torch, scene):
    expected, expected_gradients = _rendered(ReferenceRasterizer(), scene)
    actual, gradients = _rendered(gsplat_in_torch, scene)
    for name in ("color", "alpha", "depth"):
        found, wanted = getattr(actual, name)[scene.decided], getattr(expected, name)[scene.decided]
        torch.testing.assert_close(
            found, wanted, rtol=1e-6, atol=1e-6, msg=lambda m, name=name: f"{name}: {m}"
        )
    torch.testing.assert_close(actual.radii_px, expected.radii_px, rtol=1e-6, atol=1e-6)
    assert torch.equal(actual.radii_px > 0, expected.radii_px > 0)
    assert gradients.keys() == expected_gradients.keys()
    for name, wanted in expected_gradients.items():
        largest = float(wanted.abs().max()) if wanted.numel() else 0.0
        torch.testing.assert_close(
            gradients[name], wanted, rtol=0, atol=1e-6 * largest, msg=lambda m, name=name: f"{name}: {m}"
        )
    counted, wanted = _counted(actual), _counted(expected)
    assert torch.equal(counted.views, wanted.views)
    torch.testing.assert_close(counted.mean(), wanted.mean(), rtol=1e-6, atol=1e-6)


def test_without_gradients_there_are_no_screen_means(gsplat_in_torch, scene):
    with torch.no_grad():
        rendering = gsplat_in_torch.render(scene.copy(), scene.camera, scene.camera_from_model)
    assert rendering.screen_means is None
    assert rendering.color.dtype == torch.float32


def test_a_lower_degree_of_harmonics_ignores_the_rest(gsplat_in_torch, make_gaussians):
    camera, pose = PinholeCamera(32, 24, 30.0, 30.0, 16.0, 12.0), RigidTransform(np.eye(3), np.zeros(3))
    gaussians = make_gaussians(50)
    low = Gaussians(**gaussians.tensors())
    low.sh_rest = torch.cat([gaussians.sh_rest[:, :3], torch.zeros_like(gaussians.sh_rest[:, 3:])], dim=1)
    one = gsplat_in_torch.render(gaussians, camera, pose, sh_degree=1)
    assert torch.allclose(one.color, gsplat_in_torch.render(low, camera, pose).color, atol=1e-6)
    assert not torch.allclose(one.color, gsplat_in_torch.render(gaussians, camera, pose).color, atol=1e-3)


def test_kernels_that_do_not_load_are_not_missing_ones(fake_gsplat):
    (fake_gsplat / "__init__.py").write_text("")
    (fake_gsplat / "csrc.py").write_text("raise ImportError('csrc.so: undefined symbol')")
    with pytest.raises(BackendUnavailableError, match=r"cannot load its kernels: csrc\.so: undefined symbol"):
        create_rasterizer("gsplat")


def test_nothing_is_compiled_where_the_kernels_are_missing(fake_gsplat):
    (fake_gsplat / "__init__.py").write_text("")
    (fake_gsplat / "cuda").mkdir()
    (fake_gsplat / "cuda" / "_backend.py").write_text("raise AssertionError('It compiles.')")
    with pytest.raises(BackendUnavailableError, match="with its kernels compiled") as raised:
        create_rasterizer("gsplat")
    assert "docs/operate/gpu.md" in raised.value.hint
