"""Rows of hits add up to the gradients of the CPU's kernels, and with theirs to those of the reference."""

import numpy as np
import pytest
import torch
from projected_splats import flat_splats, packed_view, project_scenes, rasterize_scene
from raster_scenes import FOR_THE_INTERPRETER, SMALL_CAMERA, build_few

from fvs_engine.splat.conventions import (
    CENTER_X,
    CENTER_Y,
    EXTENT_X,
    EXTENT_Y,
    GRADIENT_SIZE,
    SLOPE_X,
    SLOPE_Y,
    WIDTH,
)
from fvs_engine.splat.raster.cpu import as_floats
from fvs_engine.splat.raster.kernels import blending as cpu_blending
from fvs_engine.splat.raster.kernels import projection as cpu_projection
from fvs_engine.splat.raster.reference import ReferenceRasterizer
from fvs_engine.splat.triton_kernels.binning import bin_hits
from fvs_engine.splat.triton_kernels.blending import blend
from fvs_engine.splat.triton_kernels.blending_backward import blend_backward

SIZE = (SMALL_CAMERA.width, SMALL_CAMERA.height)


@pytest.fixture(autouse=True)
def rooms(monkeypatch):
    """The memory of rows and some behind them, all NaN where nothing was written."""
    rooms = []
    new_empty = torch.Tensor.new_empty

    def with_room_behind(like, shape, **options):
        if options:  # the interpreter's
            return new_empty(like, shape, **options)
        rooms.append(like.new_full((shape[0] + 64, *shape[1:]), torch.nan))
        return rooms[-1][: shape[0]]

    monkeypatch.setattr(torch.Tensor, "new_empty", with_room_behind)
    return rooms


def weights_of(scenes):
    """Gradients of a loss by color, alpha and depth: random, and 0 where float32 cannot decide."""
    generator = torch.Generator().manual_seed(3)
    decided = torch.stack([scene.decided for scene in scenes])
    weights = torch.randn(*decided.shape, 5, generator=generator) * decided[..., None]
    return weights[..., :3].contiguous(), weights[..., 3].contiguous(), weights[..., 4].contiguous()


def sum_rows(rows, hits):
    """The sum of every splat's rows: [C, N, 10]."""
    rows = rows.cpu()
    cameras, count = hits.order.shape
    gradients = torch.zeros(cameras, count, GRADIENT_SIZE)
    for camera in range(cameras):
        for place, n in enumerate(hits.order[camera].tolist()):
            first, end = hits.starts[camera * count + place : camera * count + place + 2].tolist()
            gradients[camera, n] = rows[first:end].sum(0)
    return gradients


def gradients_of(scenes, weights, *, all_images=True):
    """Ours, by the splats' records."""
    few = project_scenes(scenes)
    hits = bin_hits(few, SIZE)
    images = blend(few, hits, SIZE, depth=all_images)
    weights = [None if weight is None else weight.to(few.radii.device) for weight in weights]
    rows = blend_backward(few, hits, images, weights if all_images else (weights[0], None, None))
    assert rows.shape == (hits.capacity, GRADIENT_SIZE)
    return sum_rows(rows, hits)


def cpu_gradients_of(scene, weights):
    forward = rasterize_scene(scene)
    rows = np.empty((len(forward.hit_splats), GRADIENT_SIZE), np.float32)
    cpu_blending.blend_backward(
        forward.splats, forward.tile_starts, forward.hit_splats, forward.hit_rows, forward.hit_numbers,
        forward.color, forward.alpha, forward.depth, *(weight.numpy() for weight in weights), rows,
    )  # fmt: skip
    gradients = np.zeros((len(scene.gaussians), GRADIENT_SIZE), np.float32)
    cpu_blending.sum_hits(rows, forward.splat_starts, forward.order, gradients)
    return torch.from_numpy(gradients)


def parameter_gradients(scene, gradients):
    """Gradients of records, carried back to the parameters by the CPU's kernels."""
    forward, view = rasterize_scene(scene), packed_view(scene)
    parameters = [as_floats(tensor) for tensor in scene.gaussians.tensors().values()]
    means, log_scales, quaternions, _, _, sh_rest = parameters
    outputs = [np.zeros_like(parameter) for parameter in parameters]
    cpu_projection.project_backward(
        means, log_scales, quaternions, sh_rest, view.degree, view.vector, view.size,
        forward.records, forward.radii, gradients.numpy(), *outputs,
    )  # fmt: skip
    return dict(zip(scene.gaussians.tensors(), map(torch.from_numpy, outputs), strict=True))


@pytest.mark.parametrize("name", FOR_THE_INTERPRETER)
def test_gradients_agree(name):
    scenes = build_few(name)[: 2 if name == "needles" else 1]
    weights = weights_of(scenes)
    found = gradients_of(scenes, weights)
    for camera, scene in enumerate(scenes):
        of_camera = [weight[camera] for weight in weights]
        expected = cpu_gradients_of(scene, of_camera)
        largest = expected.abs().amax(0) if len(expected) else torch.zeros(GRADIENT_SIZE)
        assert ((found[camera] - expected).abs() <= 1e-3 * largest).all()

        exact = scene.copy(torch.float64)
        rendering = ReferenceRasterizer().render(exact, scene.camera, scene.camera_from_model)
        images = (rendering.color, rendering.alpha, rendering.depth)
        sum((image * weight).sum() for image, weight in zip(images, of_camera, strict=True)).backward()
        ours = parameter_gradients(scene, found[camera])
        for key, parameter in exact.tensors().items():
            if parameter.numel() > 0:
                difference = (ours[key] - parameter.grad).abs().max()
                assert difference <= 1e-3 * parameter.grad.abs().max(), key


def test_gradients_of_color_alone_agree():
    scenes = build_few("random")[:1]
    color, alpha, depth = weights_of(scenes)
    found = gradients_of(scenes, (color, None, None), all_images=False)
    same = gradients_of(scenes, (color, torch.zeros_like(alpha), torch.zeros_like(depth)))
    assert torch.allclose(found, same, atol=1e-6)
    assert found.abs().max() > 0.1


def test_hits_behind_finished_pixels_and_missed_ones_have_zero_rows():
    """A tile of 9 px has 40 opaque splats: 16 are blended, the others hidden."""
    splats = flat_splats([0.9] * 41)
    # The last one's box reaches the second tile; its ellipse, a thin line, does not.
    last = splats.records[0, 40]
    last[[CENTER_X, CENTER_Y]] = torch.tensor([9.0, 1.5])
    last[[EXTENT_X, EXTENT_Y]] = torch.tensor([8.0, 50.0])
    last[[WIDTH, SLOPE_X, SLOPE_Y]] = torch.tensor([0.1, 0.16, 6.25])
    size = (18, 3)
    hits = bin_hits(splats, size, capacity=90)
    needed = int(hits.starts[-1])
    assert needed == 82
    assert hits.tile_starts.tolist() == [0, 41, 81]
    images = blend(splats, hits, size, depth=False)
    rows = blend_backward(splats, hits, images, (torch.ones_like(images[0]), None, None))
    blended = hits.numbers[:4].long()
    assert (rows[blended].abs().sum(1) > 0).all()
    written = rows[:needed]
    assert written.isfinite().all()
    hidden_or_missed = torch.cat([hits.numbers[16:41], hits.numbers[41 + 16 : needed]]).long()
    assert (rows[hidden_or_missed] == 0).all()
    assert rows[needed:].isnan().all(), "behind the last hit nothing is written"


def test_rows_beyond_the_capacity_are_not_written(rooms):
    few = project_scenes(build_few("huge")[:1])
    hits = bin_hits(few, SIZE, capacity=11)
    assert int(hits.starts[-1]) > 11
    images = blend(few, hits, SIZE, depth=False)
    rows = blend_backward(few, hits, images, (torch.ones_like(images[0]), None, None))
    assert rows.shape == (11, GRADIENT_SIZE)
    assert rows.isfinite().all()
    (room,) = rooms
    assert room[11:].isnan().all()
