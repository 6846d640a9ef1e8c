"""Images are those of the reference in float64 and of the CPU's kernels."""

import pytest
import torch
from projected_splats import project_scenes, projected, rasterize_scene
from raster_scenes import SCENES, SMALL_CAMERA, build_few

from fvs_engine.splat.raster.reference import ReferenceRasterizer
from fvs_engine.splat.triton_kernels.binning import bin_hits
from fvs_engine.splat.triton_kernels.blending import blend

SIZE = (SMALL_CAMERA.width, SMALL_CAMERA.height)


def blend_few(name, *, depth=True):
    few = project_scenes(build_few(name))  # two cameras at once
    return blend(few, bin_hits(few, SIZE), SIZE, depth=depth)


@pytest.mark.parametrize("name", SCENES)
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


def test_a_finished_pixel_takes_no_fainter_splat():
    """The second splat would take too much light; the third, which would not, must not come after all."""
    scene = build_few("random")[0]
    few = project_scenes([scene])
    records = few.records[:, :1].repeat(1, 3, 1)
    records[0, :, 0:2] = torch.tensor([4.5, 4.5])
    records[0, :, 2:5] = torch.tensor([1e-3, 0.0, 1e-3])
    records[0, :, 5] = torch.tensor([0.9985, 0.99, 0.5])
    records[0, :, 6:9] = torch.eye(3)
    records[0, :, 9] = torch.tensor([1.0, 2.0, 3.0])
    records[0, :, 10:14] = 50.0
    records[0, :, 14:] = 0.0
    flat = projected(records, torch.full((1, 3), 50.0))
    color, alpha, _ = blend(flat, bin_hits(flat, (9, 9)), (9, 9), depth=False)
    assert torch.allclose(alpha, torch.tensor(0.9985), atol=1e-4)
    assert torch.equal(color[..., 1:], torch.zeros(1, 9, 9, 2))
