"""Images are those of the reference in float64 and of the CPU's kernels."""

import pytest
import torch
from projected_splats import flat_splats, project_scenes, rasterize_scene
from raster_scenes import FOR_THE_INTERPRETER, SMALL_CAMERA, build_few

from fvs_engine.splat.conventions import FACTOR_A, FACTOR_B
from fvs_engine.splat.raster.reference import ReferenceRasterizer
from fvs_engine.splat.triton_kernels.binning import bin_hits
from fvs_engine.splat.triton_kernels.blending import blend

SIZE = (SMALL_CAMERA.width, SMALL_CAMERA.height)


def blend_on_cpu(splats, size, *, depth):
    images = blend(splats, bin_hits(splats, size), size, depth=depth)
    return [None if image is None else image.cpu() for image in images]


def blend_few(name, *, depth=True):
    return blend_on_cpu(project_scenes(build_few(name)), SIZE, depth=depth)  # two cameras at once


@pytest.mark.parametrize("name", FOR_THE_INTERPRETER)
def test_images_agree(name):
    color, alpha, depth = blend_few(name)
    for camera, scene in enumerate(build_few(name)):
        with torch.no_grad():
            exact = ReferenceRasterizer().render(
                scene.copy(torch.float64), scene.camera, scene.camera_from_model
            )
        ours = rasterize_scene(scene)
        assert (color[camera] - exact.color).abs()[scene.decided].max() <= 1e-4
        assert (alpha[camera] - exact.alpha).abs()[scene.decided].max() <= 1e-4
        depth_scale = max(1.0, float(exact.depth.max()))
        assert (depth[camera] - exact.depth).abs()[scene.decided].max() <= 1e-4 * depth_scale
        for image, other in ((color, ours.color), (alpha, ours.alpha), (depth, ours.depth)):
            assert (image[camera] - torch.from_numpy(other)).abs()[scene.decided].max() <= 1e-4 * depth_scale


def test_without_depth_the_other_images_are_the_same():
    color, alpha, _ = blend_few("needles")
    same_color, same_alpha, none = blend_few("needles", depth=False)
    assert none is None
    assert torch.equal(color, same_color)
    assert torch.equal(alpha, same_alpha)


@pytest.mark.parametrize("size", [(1, 1), (9, 9), (600, 1), (1, 300)])
def test_sizes_of_images(size):
    splat = flat_splats([0.5])
    splat.records[..., [FACTOR_A, FACTOR_B]] = 1e-9
    color, alpha, depth = blend_on_cpu(splat, size, depth=True)
    width, height = size
    assert torch.allclose(color, torch.tensor([0.5, 0.0, 0.0]).expand(1, height, width, 3))
    assert torch.allclose(alpha, torch.full((1, height, width), 0.5))
    assert torch.allclose(depth, alpha)


def test_a_finished_pixel_takes_no_fainter_splat():
    """The second splat would take too much light; the third, which would not, must not come after all."""
    splats = flat_splats([0.9985, 0.99, 0.5])
    color, alpha, _ = blend_on_cpu(splats, (9, 9), depth=False)
    assert torch.allclose(alpha, torch.tensor(0.9985), atol=1e-4)
    assert torch.equal(color[..., 1:], torch.zeros(1, 9, 9, 2))
