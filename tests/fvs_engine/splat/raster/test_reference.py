"""The oracle itself: autograd against finite differences, and cases one can work out by hand."""

import math

import pytest
import torch

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.reference import ReferenceRasterizer

POSE = RigidTransform.identity()


def test_gradcheck_in_float64(make_gaussians):
    camera = PinholeCamera(12, 9, 10.0, 11.0, 6.5, 4.0)
    gaussians = make_gaussians(6)
    names = list(gaussians.tensors())
    # Broad splats: no pixel near a threshold, where the image jumps and no derivative exists.
    gaussians.log_scales += 3.0
    inputs = [tensor.double().requires_grad_() for tensor in gaussians.tensors().values()]

    def render(*tensors):
        rendering = ReferenceRasterizer().render(
            Gaussians(**dict(zip(names, tensors, strict=True))), camera, POSE
        )
        return rendering.color, rendering.alpha, rendering.depth

    assert torch.autograd.gradcheck(render, inputs, eps=1e-6, atol=1e-6, rtol=1e-4, fast_mode=True)


def one_gaussian(opacity: float, scale: float) -> Gaussians:
    return Gaussians(
        means=torch.tensor([[0.0, 0.0, 2.0]]),
        log_scales=torch.full((1, 3), math.log(scale)),
        quaternions_wxyz=torch.tensor([[2.0, 0.0, 0.0, 0.0]]),
        opacity_logits=torch.tensor([math.log(opacity / (1 - opacity))]),
        sh_dc=torch.zeros(1, 3),
        sh_rest=torch.zeros(1, 0, 3),
    )


def test_one_gaussian_is_a_blurred_disc():
    focal, scale, opacity = 40.0, 0.2, 0.8
    camera = PinholeCamera(33, 33, focal, focal, 16.5, 16.5)
    rendering = ReferenceRasterizer().render(one_gaussian(opacity, scale), camera, POSE)
    variance_px2 = (focal * scale / 2.0) ** 2 + 0.3
    for offset in (0, 3, 7):
        expected = opacity * math.exp(-0.5 * offset**2 / variance_px2)
        assert rendering.alpha[16, 16 + offset] == pytest.approx(expected, rel=1e-5)
        assert rendering.color[16 + offset, 16, 1] == pytest.approx(0.5 * expected, rel=1e-5)
    assert rendering.depth[16, 16] == pytest.approx(2.0 * opacity, rel=1e-5)


def test_the_nearer_splat_hides_the_farther():
    near, far = one_gaussian(0.9, 0.3), one_gaussian(0.9, 0.3)
    far.means[:, 2] = 5.0
    both = Gaussians(
        **{name: torch.cat([far.tensors()[name], near.tensors()[name]]) for name in near.tensors()}
    )
    both.sh_dc[0] = -10.0  # the far one is black
    camera = PinholeCamera(17, 17, 40.0, 40.0, 8.5, 8.5)
    rendering = ReferenceRasterizer().render(both, camera, POSE)
    assert rendering.color[8, 8, 0] == pytest.approx(0.5 * 0.9, rel=1e-4)
    assert rendering.alpha[8, 8] == pytest.approx(0.99, rel=1e-4)


def test_what_is_not_covered_is_black():
    camera = PinholeCamera(17, 17, 40.0, 40.0, 8.5, 8.5)
    rendering = ReferenceRasterizer().render(one_gaussian(0.5, 0.01), camera, POSE)
    assert not rendering.color[0, 0].any()
    assert torch.allclose(rendering.color[8, 8], 0.5 * rendering.alpha[8, 8])
