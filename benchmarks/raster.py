"""Speed of the CPU kernels, compared with the plain-torch reference and on one and two threads.

    python benchmarks/raster.py [--quick] [--json results/raster.json]

Three tables. Against the reference (goal: ≥ 50×): a whole forward and backward pass of both, in turns.
Threads (goal: ≥ 1.7×): the two blending kernels and the whole pass on one thread and on two, in turns.
Sweep: Gaussians × image sizes, with the time per million *pixel hits* (a splat's alpha in a pixel).
"""

import argparse
import itertools
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numba
import numpy as np
import torch
from measurement import Timing, measure_side_by_side, report
from room import candidates, scene

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, create_rasterizer
from fvs_engine.splat.raster import cpu as cpu_rasterizer
from fvs_engine.splat.raster.kernels import binning, blending
from fvs_engine.views import PinholeView

SIZES = ((480, 270), (960, 540), (1920, 1080))
FEW_GAUSSIANS = 13_000


class Passes:
    """``forward`` and ``whole`` (forward and backward) passes of one backend over one view."""

    def __init__(self, rasterizer: Rasterizer, gaussians: Gaussians, view: PinholeView) -> None:
        self.rasterizer, self.view = rasterizer, view
        self.gaussians = Gaussians(**{k: t.clone().requires_grad_() for k, t in gaussians.tensors().items()})
        size = (view.camera.height, view.camera.width, 3)
        self.weights = torch.randn(size, generator=torch.Generator().manual_seed(0))

    def forward(self) -> None:
        with torch.no_grad():
            self.rasterizer.render(self.gaussians, self.view.camera, self.view.camera_from_model)

    def whole(self) -> None:
        rendering = self.rasterizer.render(self.gaussians, self.view.camera, self.view.camera_from_model)
        torch.autograd.backward(rendering.color, self.weights)
        for tensor in self.gaussians.tensors().values():
            tensor.grad = None


class Kernels:
    """The blending kernels ``forward`` and ``backward`` by themselves, on one view's binned splats."""

    def __init__(self, gaussians: Gaussians, view: PinholeView) -> None:
        one_view = cpu_rasterizer.PackedView(view.camera, view.camera_from_model, 0)
        arrays = [cpu_rasterizer.as_floats(tensor) for tensor in gaussians.tensors().values()]
        self.state = cpu_rasterizer.rasterize(one_view, arrays)
        rng = np.random.default_rng(0)
        self.gradients = [rng.normal(size=image.shape).astype(np.float32) for image in self._images]
        self.hit_gradients = np.zeros((len(self.state.hit_splats), 10), np.float32)

    @property
    def _images(self) -> tuple[np.ndarray, ...]:
        return self.state.color, self.state.alpha, self.state.depth

    @property
    def pixel_hits(self) -> int:
        """Alphas evaluated in a forward pass in which no row is finished early."""
        rows = self.state.hit_rows.astype(np.int64)
        return int((rows[:, 1::2] - rows[:, ::2]).sum()) * binning.LANES

    def forward(self) -> None:
        s = self.state
        with numba.parallel_chunksize(cpu_rasterizer.TILES_AT_ONCE):
            blending.blend(s.splats, s.tile_starts, s.hit_splats, s.hit_rows, *self._images)

    def backward(self) -> None:
        s = self.state
        with numba.parallel_chunksize(cpu_rasterizer.TILES_AT_ONCE):
            blending.blend_backward(
                s.splats, s.tile_starts, s.hit_splats, s.hit_rows, s.hit_numbers,
                *self._images, *self.gradients, self.hit_gradients,
            )  # fmt: skip


def on_threads(count: int, function: Callable[[], None]) -> Callable[[], None]:
    """The function on ``count`` of the process's threads."""

    def run() -> None:
        before = numba.get_num_threads()
        numba.set_num_threads(count)
        try:
            function()
        finally:
            numba.set_num_threads(before)

    return run


def with_torch_threads(count: int, function: Callable[[], None]) -> Callable[[], None]:
    """The function while torch may use ``count`` threads: its pool spins after each operation."""

    def run() -> None:
        before = torch.get_num_threads()
        torch.set_num_threads(count)
        try:
            function()
        finally:
            torch.set_num_threads(before)

    return run


def against_reference(quick: bool) -> list[dict[str, Any]]:
    """Compare both backends, in turns and on all cores. The reference's memory limits the sizes."""
    rows = []
    sizes = [(240, 136)] if quick else [(240, 136), (480, 270), (960, 540)]
    for width, height in sizes:
        gaussians, (view,) = scene(FEW_GAUSSIANS), candidates(1, width, height)
        ours = Passes(create_rasterizer("cpu"), gaussians, view)
        oracle = Passes(create_rasterizer("reference"), gaussians, view)
        for name in ("forward", "whole"):
            functions = {
                "cpu": with_torch_threads(1, getattr(ours, name)),
                "reference": with_torch_threads(numba.get_num_threads(), getattr(oracle, name)),
            }
            times = measure_side_by_side(functions, repeat=3)
            rows.append(
                {
                    "Gaussians": FEW_GAUSSIANS,
                    "image": f"{width}×{height}",
                    "pass": "forward" if name == "forward" else "forward + backward",
                    **times,
                    "× reference": times["reference"].median_s / times["cpu"].median_s,
                }
            )
    return rows


def thread_scaling(repeat: int) -> list[dict[str, Any]]:
    """One thread and two, in turns."""
    gaussians, (view,) = scene(100_000), candidates(1, 960, 540)
    kernels, passes = Kernels(gaussians, view), Passes(create_rasterizer("cpu"), gaussians, view)
    parts = {"blend": kernels.forward, "blend backward": kernels.backward, "forward + backward": passes.whole}
    rows = []
    for name, function in parts.items():
        times = measure_side_by_side({str(n): on_threads(n, function) for n in (1, 2)}, repeat)
        row: dict[str, Any] = {"part": name, "1 thread": times["1"], "2 threads": times["2"]}
        rows.append({**row, "speed-up": times["1"].median_s / times["2"].median_s})
    return rows


def sweep(quick: bool, repeat: int) -> list[dict[str, Any]]:
    """Gaussians × image sizes."""
    rows = []
    for count, (width, height) in itertools.product(
        (FEW_GAUSSIANS, 100_000, 300_000), SIZES[: 2 if quick else 3]
    ):
        gaussians, (view,) = scene(count), candidates(1, width, height)
        kernels, passes = Kernels(gaussians, view), Passes(create_rasterizer("cpu"), gaussians, view)
        times: dict[str, Timing] = measure_side_by_side(
            {
                "blend": kernels.forward,
                "blend backward": kernels.backward,
                "forward + backward": passes.whole,
            },
            repeat,
        )
        blended = times["blend"].median_s + times["blend backward"].median_s
        rows.append(
            {
                "Gaussians": count,
                "image": f"{width}×{height}",
                "tile hits": len(kernels.state.hit_splats),
                **times,
                "ms per M pixel hits": 1e9 * blended / kernels.pixel_hits,
                "share of the two kernels": blended / times["forward + backward"].median_s,
            }
        )
    return rows


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--quick", action="store_true", help="the smallest cases only")
    parser.add_argument("--repeat", type=int, default=7)
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    torch.set_num_threads(1)
    parts = {
        "against the reference": against_reference(options.quick),
        "threads": thread_scaling(options.repeat),
        "sweep": sweep(options.quick, options.repeat),
    }
    for name, rows in parts.items():
        path = options.json and options.json.with_stem(f"{options.json.stem}-{name.split()[0]}")
        report(f"raster: {name}", rows, path)


if __name__ == "__main__":
    main()
