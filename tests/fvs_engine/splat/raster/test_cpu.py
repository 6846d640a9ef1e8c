"""What only the Numba backend has to prove: its arithmetic, its threads, its cache."""

import json
import subprocess
import sys
import threading

import numba
import numpy as np
import pytest
import torch

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.raster import create_rasterizer
from fvs_engine.splat.raster.cpu import CpuRasterizer
from fvs_engine.splat.raster.kernels.blending import exp_of_minus_eight
from fvs_engine.splat.raster.reference import ReferenceRasterizer

CAMERA = PinholeCamera(200, 150, 150.0, 150.0, 100.0, 75.0)
POSE = RigidTransform.identity()


def test_exponential_is_exact_where_it_matters():
    y = np.linspace(0.0, 0.75, 20_001, dtype=np.float32)
    found = np.array([exp_of_minus_eight(value) for value in y])
    assert np.abs(found / np.exp(-8.0 * y.astype(np.float64)) - 1).max() < 3e-6
    assert np.all(np.diff(found) <= 1e-6), "no staircase"
    assert exp_of_minus_eight(np.float32(1e30)) < 1 / 255


def render_with_gradients(gaussians, seed=0):
    leaves = type(gaussians)(**{k: t.clone().requires_grad_() for k, t in gaussians.tensors().items()})
    rendering = CpuRasterizer().render(leaves, CAMERA, POSE)
    weights = torch.randn(rendering.color.shape, generator=torch.Generator().manual_seed(seed))
    (rendering.color * weights).sum().backward()
    return rendering.color.detach(), [t.grad for t in leaves.tensors().values()]


def test_any_number_of_threads_gives_the_same_bits(make_gaussians):
    gaussians = make_gaussians(3000)

    def render():
        drawn = CpuRasterizer().render(gaussians, CAMERA, POSE)
        images, gradients = render_with_gradients(gaussians)
        return [images, *gradients, drawn.color, drawn.alpha, drawn.depth]

    threads = numba.get_num_threads()
    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.skip("needs two threads: unset NUMBA_NUM_THREADS, on a machine with two processors")
    try:
        numba.set_num_threads(numba.config.NUMBA_NUM_THREADS)
        many = render()
        numba.set_num_threads(1)
        one = render()
    finally:
        numba.set_num_threads(threads)
    assert all(torch.equal(a, b) for a, b in zip(many, one, strict=True))


def test_splats_outside_of_the_image_are_told_by_their_size_alone_only_if_they_miss_it(make_gaussians):
    """The quick test in ``project`` must keep all that the exact one keeps: the least that peep in."""
    gaussians = make_gaussians(3000)
    gaussians.means[:, :2] *= 4
    gaussians.log_scales[::2] = gaussians.log_scales[::2, :1] + 1.0  # spheres: the bound is tight
    gaussians.opacity_logits[:] = 8.0
    with torch.no_grad():
        expected = ReferenceRasterizer().render(gaussians, CAMERA, POSE).radii_px > 0
        found = CpuRasterizer().render(gaussians, CAMERA, POSE).radii_px > 0
    assert 0 < expected.sum() < len(gaussians)
    assert torch.equal(found, expected)


def test_ranking_may_render_while_training_does(make_gaussians):
    """The default threading layer of Numba aborts the process here."""
    gaussians = make_gaussians(2000)
    expected = render_with_gradients(gaussians)
    differing = []

    def work():
        for _ in range(20):
            found = render_with_gradients(gaussians)
            if not torch.equal(found[0], expected[0]):
                differing.append(found)

    workers = [threading.Thread(target=work) for _ in range(3)]
    for worker in workers:
        worker.start()
    for worker in workers:
        worker.join()
    assert not differing


def test_non_finite_gaussians_do_not_reach_the_image(make_gaussians):
    gaussians = make_gaussians(300)
    clean = CpuRasterizer().render(gaussians, CAMERA, POSE).color
    broken = make_gaussians(300)
    broken.means[7] = torch.nan
    broken.log_scales[8] = torch.inf
    broken.opacity_logits[9] = torch.nan
    keep = torch.ones(300, dtype=torch.bool)
    keep[7:10] = False
    without = type(gaussians)(**{k: t[keep] for k, t in gaussians.tensors().items()})
    image = CpuRasterizer().render(broken, CAMERA, POSE).color
    assert torch.equal(image, CpuRasterizer().render(without, CAMERA, POSE).color)
    assert not torch.equal(image, clean)


SECOND_START = """
import json, torch
from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.cpu import CpuRasterizer
from fvs_engine.splat.raster.kernels import binning, blending, drawing, projection

torch.manual_seed(0)
g = Gaussians(torch.randn(9, 3) + torch.tensor([0, 0, 4.0]), torch.randn(9, 3) - 2, torch.randn(9, 4),
              torch.randn(9), torch.randn(9, 3), torch.randn(9, 15, 3)).requires_grad_()
camera = PinholeCamera(40, 30, 30, 30, 20, 15)
CpuRasterizer().render(g, camera, RigidTransform.identity()).color.sum().backward()
with torch.no_grad():
    CpuRasterizer().render(g, camera, RigidTransform.identity())
kernels = [projection.project, projection.project_backward, binning.front_to_back, binning.gather,
           binning.bin_splats, blending.blend, blending.blend_backward, blending.sum_hits,
           drawing.deal, drawing.draw]
print(json.dumps([sum(k.stats.cache_misses.values()) for k in kernels]))
"""


@pytest.mark.system
@pytest.mark.process
def test_a_second_process_compiles_nothing():
    create_rasterizer("cpu")  # the first process: nothing has to be compiled after this
    second = subprocess.run([sys.executable, "-c", SECOND_START], check=True, capture_output=True, text=True)
    assert json.loads(second.stdout) == [0] * 10
