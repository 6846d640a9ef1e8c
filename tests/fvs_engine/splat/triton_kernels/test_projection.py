"""Records, and the gradients of parameters, are those of the reference in float64."""

from collections.abc import Callable
from dataclasses import replace

import pytest
import torch
from raster_scenes import CAMERA, FOR_THE_INTERPRETER, build_scene, random_splats
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.conventions import EXTENT_X, GRADIENT_SIZE, HEIGHT, RED, SLOPE_X, SLOPE_Y, WIDTH
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import reference_projection
from fvs_engine.splat.raster.reference_projection import ScreenSplats
from fvs_engine.splat.triton_kernels.projection import project
from fvs_engine.splat.triton_kernels.projection_backward import project_backward

AsCameras = Callable[..., Tensor]
SIZE = (CAMERA.width, CAMERA.height)
POSE = RigidTransform.identity()
AT_RIGHT = RigidTransform(POSE.rotation, POSE.translation - [0.5, 0.0, 0.2])
of_every_scene = pytest.mark.parametrize(
    "name", [name for name in FOR_THE_INTERPRETER if name != "one pixel"]
)


def some(count: int = 40, sh_degree: int = 3) -> Gaussians:
    return random_splats(count, torch.Generator().manual_seed(1), sh_degree)


def exact(gaussians: Gaussians) -> Gaussians:
    """A copy in float64 that collects gradients."""
    tensors = gaussians.tensors().items()
    return Gaussians(**{name: t.detach().cpu().double() for name, t in tensors}).requires_grad_()


def blended(splats: ScreenSplats) -> Tensor:
    """What has gradients of a record, [N, 10]."""
    opacities, depths = splats.opacities[:, None], splats.depths[:, None]
    return torch.cat([splats.centers, splats.factors, opacities, splats.colors, depths], dim=1)


@of_every_scene
def test_records_are_those_of_the_reference(name, device, as_cameras: AsCameras):
    scene = build_scene(name)
    gaussians = scene.copy(device=str(device)).requires_grad_(False)
    found = project(gaussians, as_cameras(CAMERA, scene.camera_from_model), SIZE, 3)
    with torch.no_grad():
        expected = reference_projection.project(exact(gaussians), CAMERA, scene.camera_from_model, 3)
    visible = expected.visible
    assert torch.equal(found.radii[0].cpu() > 0, visible)
    records = found.records[0].cpu().double()[visible]
    values = torch.cat([blended(expected), expected.extents_px], dim=1)[visible]
    assert torch.allclose(records[:, :WIDTH], values, rtol=1e-4, atol=2e-6)
    # The ellipse: its box is as far out as its middle line and its width there say.
    extents, slopes = records[:, EXTENT_X : EXTENT_X + 2], records[:, SLOPE_X : SLOPE_Y + 1]
    half = records[:, WIDTH : HEIGHT + 1]
    correlations = slopes.prod(1, keepdim=True)
    assert torch.allclose(half, extents * (1 - correlations).clamp_min(0).sqrt(), rtol=1e-2, atol=1e-2)
    assert torch.allclose(slopes[:, 0] * extents[:, 1] ** 2, slopes[:, 1] * extents[:, 0] ** 2, rtol=1e-4)


@of_every_scene
def test_gradients_are_those_of_the_reference(name, device, as_cameras: AsCameras):
    scene = build_scene(name)
    gaussians = scene.copy(device=str(device)).requires_grad_(False)
    check_gradients(gaussians, as_cameras, 3, scene.camera_from_model)


@pytest.mark.parametrize("degree", [0, 1, 2])
def test_degrees_that_are_not_in_use_have_no_gradient(degree, device, as_cameras: AsCameras):
    gaussians = some().to(device)
    gradients = check_gradients(gaussians, as_cameras, degree, POSE)
    assert not gradients["sh_rest"][:, (degree + 1) ** 2 - 1 :].any()


@pytest.mark.parametrize("stored", [0, 1])
def test_fewer_degrees_may_be_stored(stored, device, as_cameras: AsCameras):
    check_gradients(some(sh_degree=stored).to(device), as_cameras, stored, POSE)


def test_gradients_are_summed_over_cameras(device, as_cameras: AsCameras):
    check_gradients(some().to(device), as_cameras, 3, POSE, AT_RIGHT, POSE)


def check_gradients(
    gaussians: Gaussians, as_cameras: AsCameras, degree: int, *poses: RigidTransform
) -> dict[str, Tensor]:
    cameras = as_cameras(CAMERA, *poses)
    projected = project(gaussians, cameras, SIZE, degree)
    weights = torch.randn(
        len(poses), len(gaussians), GRADIENT_SIZE, generator=torch.Generator().manual_seed(3)
    )
    wanted = exact(gaussians)
    for pose, weight in zip(poses, weights, strict=True):
        splats = reference_projection.project(wanted, CAMERA, pose, degree)
        (blended(splats) * weight)[splats.visible].sum().backward()
    found = project_backward(gaussians, cameras, SIZE, degree, projected, weights.to(gaussians.device))
    for key, tensor in wanted.tensors().items():
        gradient = torch.zeros_like(tensor) if tensor.grad is None else tensor.grad
        assert found[key].shape == gradient.shape, key
        largest = gradient.abs().max() if gradient.numel() else 0.0
        assert torch.allclose(found[key].cpu().double(), gradient, rtol=0, atol=2e-4 * largest), key
    return found


def test_cameras_are_independent(device, as_cameras: AsCameras):
    gaussians = some().to(device)
    both = project(gaussians, as_cameras(CAMERA, AT_RIGHT, POSE), SIZE, 3)
    alone = project(gaussians, as_cameras(CAMERA, POSE), SIZE, 3)
    visible = alone.radii[0] > 0
    assert torch.equal(both.radii[1], alone.radii[0])
    assert torch.equal(both.records[1][visible], alone.records[0][visible])
    assert not torch.equal(both.radii[0], alone.radii[0])


@pytest.mark.filterwarnings("ignore:.*encountered:RuntimeWarning")  # numpy's, in the interpreter
def test_what_is_not_finite_is_culled_and_has_no_gradient(device, as_cameras: AsCameras):
    gaussians = some().to(device)
    broken = some().to(device)
    broken.means[1, 0] = torch.nan
    broken.means[2, 2] = torch.inf
    broken.log_scales[3] = torch.inf
    broken.log_scales[4, 1] = torch.nan
    broken.opacity_logits[5] = torch.nan
    broken.quaternions_wxyz[6, 3] = torch.nan
    cameras = as_cameras(CAMERA, POSE)
    found, clean = project(broken, cameras, SIZE, 3), project(gaussians, cameras, SIZE, 3)
    assert not found.radii[0, 1:7].any()
    assert torch.equal(found.radii[0, 7:], clean.radii[0, 7:])
    gradients = project_backward(broken, cameras, SIZE, 3, found, torch.ones_like(found.records[..., :10]))
    for key, gradient in gradients.items():
        assert not gradient[1:7].any(), key
        assert gradient.isfinite().all(), key


def test_a_colour_that_is_not_finite_stays_so(device, as_cameras: AsCameras):
    gaussians = some().to(device)
    gaussians.sh_dc[0, 1] = torch.nan
    gaussians.sh_rest[1, 4, 2] = torch.nan
    records = project(gaussians, as_cameras(CAMERA, POSE), SIZE, 3).records[0]
    assert torch.equal(records[:2, RED : RED + 3].isnan().cpu().nonzero(), torch.tensor([[0, 1], [1, 2]]))


@pytest.mark.parametrize("size", [(1, 1), (8000, 8000)])
def test_images_of_one_and_of_8000_pixels(size, device, as_cameras: AsCameras):
    width, height = size
    camera = PinholeCamera(width, height, 0.8 * width, 0.8 * height, width / 2, height / 2)
    gaussians = some().to(device)
    gaussians.log_scales[0] = 8.0  # covers all
    gaussians.means[0] = torch.tensor([0.0, 0.0, 5.0])
    gaussians.opacity_logits[0] = 4.0
    found = project(gaussians, as_cameras(camera, POSE), size, 3)
    assert found.radii[0, 0] > width
    assert found.records[0, 0].isfinite().all()


def test_no_gaussians(device, as_cameras: AsCameras):
    none = replace(some(), **{name: tensor[:0] for name, tensor in some().tensors().items()}).to(device)
    cameras = as_cameras(CAMERA, POSE)
    found = project(none, cameras, SIZE, 3)
    assert found.records.shape == (1, 0, 16)
    assert all(len(g) == 0 for g in project_backward(none, cameras, SIZE, 3, found, found.records).values())
