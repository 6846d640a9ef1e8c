"""The squared Jacobian is that of the reference, value by value of the image."""

from collections.abc import Callable

import pytest
import torch
from raster_scenes import random_splats
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.reference import ReferenceRasterizer
from fvs_engine.splat.triton_kernels.binning import bin_hits
from fvs_engine.splat.triton_kernels.blending import blend
from fvs_engine.splat.triton_kernels.projection import project
from fvs_engine.splat.triton_kernels.squares import square

AsCameras = Callable[..., Tensor]
CAMERA = PinholeCamera(21, 10, 14.0, 15.0, 10.0, 5.5)  # two by two tiles
SIZE = (CAMERA.width, CAMERA.height)
POSE = RigidTransform.identity()
NAMES = ("means", "log_scales", "opacity_logits", "sh_dc", "sh_rest")


@pytest.fixture
def gaussians() -> Gaussians:
    """Some that overlap, one behind the camera, one whose alpha is clamped, one without red."""
    some = random_splats(9, torch.Generator().manual_seed(1))
    # The derivative by a mean is taken at a fixed direction of view: colour must not depend on it.
    some.sh_rest.zero_()
    some.log_scales += 0.8
    some.means[2, 2] = -1.0
    some.opacity_logits[3] = 9.0
    some.sh_dc[4, 0] = -3.0
    return some


def squared(
    gaussians: Gaussians, device: torch.device, as_cameras: AsCameras, degree: int
) -> dict[str, Tensor]:
    gaussians, cameras = gaussians.to(device), as_cameras(CAMERA, POSE)
    projected = project(gaussians, cameras, SIZE, degree)
    hits = bin_hits(projected, SIZE)
    color, _, _ = blend(projected, hits, SIZE, depth=False)
    found = square(gaussians, cameras, SIZE, degree, projected, hits, color)
    return dict(zip(NAMES, (tensor.cpu() for tensor in found), strict=True))


@pytest.mark.parametrize("degree", [0, pytest.param(1, marks=pytest.mark.system), 3])
def test_squares_are_those_of_the_reference(gaussians, degree, device, as_cameras: AsCameras):
    found = squared(gaussians, device, as_cameras, degree)
    exact = Gaussians(
        **{name: tensor.double() for name, tensor in gaussians.tensors().items()}
    ).requires_grad_()
    color = ReferenceRasterizer().render(exact, CAMERA, POSE, sh_degree=degree).color
    inputs = [exact.tensors()[name] for name in NAMES]
    jacobian = torch.autograd.grad(
        color, inputs, torch.eye(color.numel(), dtype=torch.float64).reshape(-1, *color.shape),
        is_grads_batched=True, allow_unused=True, materialize_grads=True,
    )  # fmt: skip
    for name, derivatives in zip(NAMES, jacobian, strict=True):
        expected = (derivatives**2).sum(0)
        assert torch.allclose(found[name].double(), expected, rtol=1e-3, atol=1e-4 * expected.max()), name
        assert not found[name][2].any()
    assert found["means"].abs().max() > 0


def test_no_gaussians(gaussians, device, as_cameras: AsCameras):
    none = Gaussians(**{name: tensor[:0] for name, tensor in gaussians.tensors().items()})
    assert all(len(tensor) == 0 for tensor in squared(none, device, as_cameras, 3).values())
