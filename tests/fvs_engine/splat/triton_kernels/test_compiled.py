"""What the compiler makes of binning and blending computes what the CPU's kernels do, on whole scenes."""

import numpy as np
import pytest
import torch
from compiled_kernels import compile_kernels
from projected_splats import project_scenes, rasterize_scene
from raster_scenes import SMALL_CAMERA, build_few, build_scene

from fvs_engine.splat.conventions import GRADIENT_SIZE
from fvs_engine.splat.raster.kernels import blending as cpu_blending
from fvs_engine.splat.triton_kernels import binning, blending, blending_backward
from fvs_engine.splat.triton_kernels.guard import HALTED_OVERFLOW, new_guard

pytestmark = [
    pytest.mark.process,
    pytest.mark.system,
    pytest.mark.skipif(torch.cuda.is_available(), reason="the device runs what is compiled, in other tests"),
]


@pytest.mark.parametrize("capacity", [20, 45, 700])
def test_hits_are_those_of_the_interpreter(monkeypatch, capacity):
    few, size = project_scenes(build_few("needles")), (SMALL_CAMERA.width, SMALL_CAMERA.height)
    expected = binning.bin_hits(few, size, capacity)
    compile_kernels(monkeypatch, binning, "_count_hits", "_deal_hits", "_list_hits")
    guard = new_guard(torch.device("cpu"))
    found = binning.bin_hits(few, size, capacity, guard)
    needed = int(expected.starts[-1])
    assert guard.tolist() == ([HALTED_OVERFLOW, needed] if needed > capacity else [0, 0])
    for name in ("tile_starts", "listed", "numbers", "order", "starts"):
        assert torch.equal(getattr(found, name), getattr(expected, name)), name


@pytest.mark.parametrize(
    ("name", "all_images", "capability"),
    [
        ("needles", True, 90),
        ("opaque", False, 90),
        ("one pixel", False, 90),
        ("edge", True, 80),
        ("edge", False, 100),
    ],
)
def test_images_and_gradients_agree(monkeypatch, name, all_images, capability):
    for module, *kernels in (
        (binning, "_count_hits", "_deal_hits", "_list_hits"),
        (blending, "_blend"),
        (blending_backward, "_blend_backward", "_clear_missed"),
    ):
        compile_kernels(monkeypatch, module, *kernels, capability=capability)
    scene = build_scene(name)
    splats, ours = project_scenes([scene]), rasterize_scene(scene)
    size = (scene.camera.width, scene.camera.height)
    hits = binning.bin_hits(splats, size)
    images = blending.blend(splats, hits, size, depth=all_images)
    for image, other in zip(images, (ours.color, ours.alpha, ours.depth), strict=True):
        if image is not None:
            difference = (image[0] - torch.from_numpy(other)).abs()[scene.decided].max()
            assert difference <= 1e-4 * max(1.0, float(other.max()))

    generator = torch.Generator().manual_seed(3)
    weights = [
        torch.randn(other.shape, generator=generator) * scene.decided.reshape(54, 75, *[1] * (other.ndim - 2))
        for other in (ours.color, ours.alpha, ours.depth)
    ]
    if not all_images:
        weights[1:] = [torch.zeros_like(weight) for weight in weights[1:]]
    given = [weight[None] for weight in weights] if all_images else [weights[0][None], None, None]
    rows = blending_backward.blend_backward(splats, hits, images, given)
    places = torch.searchsorted(hits.starts, torch.arange(int(hits.starts[-1])), right=True) - 1
    found = torch.zeros(len(scene.gaussians), GRADIENT_SIZE)
    found.index_add_(0, hits.order[0][places], rows)

    cpu_rows = np.empty((len(ours.hit_splats), GRADIENT_SIZE), np.float32)
    cpu_blending.blend_backward(
        ours.splats, ours.tile_starts, ours.hit_splats, ours.hit_rows, ours.hit_numbers,
        ours.color, ours.alpha, ours.depth, *(weight.numpy() for weight in weights), cpu_rows,
    )  # fmt: skip
    expected = np.zeros((len(scene.gaussians), GRADIENT_SIZE), np.float32)
    cpu_blending.sum_hits(cpu_rows, ours.splat_starts, ours.order, expected)
    largest = np.abs(expected).max(0)
    assert (np.abs(found.numpy() - expected) <= 1e-3 * largest).all()
