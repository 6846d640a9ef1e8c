"""Launch every kernel for a device that is not there: ``python benchmarks/gpu/launch.py [CAPABILITY]``.

The interpreter takes arguments that Triton's own binder and compiler refuse. Here they get them as on a GPU
of compute capability 9.0, or the one given. Only running is left out: images, gradients and losses are zero.
Prints how many variants of each kernel a device would compile.
"""

import json
import os
import sys
from collections import Counter
from collections.abc import Callable
from itertools import product
from pathlib import Path
from typing import Any

os.environ.pop("TRITON_INTERPRET", None)

import numpy as np
import torch
import triton
from triton.backends.compiler import GPUTarget
from triton.runtime.jit import JITFunction

sys.path.insert(0, str(Path(__file__).parents[1]))

from room import candidates, scene

from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.losses import photometric_loss
from fvs_engine.splat.raster.triton import TritonRasterizer
from fvs_engine.splat.settings import Densification, TrainingSettings
from fvs_engine.splat.trainer import Trainer
from fvs_engine.splat.triton_kernels.guard import StepGuard
from fvs_engine.splat.triton_kernels.median import middle_powers, planes_of
from fvs_engine.splat.views import TrainingView

CPU = torch.device("cpu")
COUNTS = (0, 1, 2, 16, 40)  # Triton makes variants for 1, and for multiples of 16
SIZES = ((1, 1), (16, 16), (75, 54))


class _Driver:
    """What Triton asks of a device's driver until it launches."""

    def __init__(self, capability: int) -> None:
        self._target = GPUTarget("cuda", capability, 32)

    def get_current_target(self) -> GPUTarget:
        return self._target

    def get_current_device(self) -> int:
        return 0

    def get_current_stream(self, _: int) -> int:
        return 0

    def get_active_torch_device(self) -> torch.device:
        return CPU

    def map_python_to_cpp_type(self, kind: str) -> str:
        return kind


def main() -> None:
    capability = int(sys.argv[1]) if len(sys.argv) > 1 else 90
    triton.runtime.driver.set_active(_Driver(capability))
    launched: dict[str, set[str]] = {}
    _compile_only(launched)
    rasterizer = TritonRasterizer(CPU)
    for count, size, degree in product(COUNTS, SIZES, (0, 1, 2, 3)):
        if degree in (0, 3) or (count, size) == (COUNTS[-1], SIZES[-1]):
            _render(rasterizer, _model(count, degree), size)
    for count, degree in ((1, 0), (16, 3), (40, 1)):
        _train(rasterizer, _model(count, degree), (75, 54))
    for width, height in SIZES:
        color, target = torch.zeros(height, width, 3), torch.zeros(height, width, 3, dtype=torch.uint8)
        photometric_loss(color, target, guard=StepGuard(CPU))
        middle_powers(torch.fft.rfft2(planes_of(color[None].repeat(2, 1, 1, 1))), width)
    variants = Counter({name: len(hashes) for name, hashes in launched.items()})
    print(json.dumps({"triton": triton.__version__, "capability": capability, "variants": variants}))


def _compile_only(launched: dict[str, set[str]]) -> None:
    """Have launches compile, and note what; what kernels would fill is 0, but every splat has a hit."""
    run: Callable[..., Any] = JITFunction.run

    def compiled(self: Any, *arguments: Any, grid: Any, warmup: bool, **options: Any) -> Any:  # noqa: ARG001
        assert all(size > 0 for size in grid), f"{self.__name__} is launched with {grid} programs"
        kernel = run(self, *arguments, grid=grid, warmup=True, **options)
        launched.setdefault(self.__name__, set()).add(kernel.hash)
        if self.__name__ == "_count_hits":
            arguments[self.arg_names.index("counts")].fill_(1)
        return kernel

    JITFunction.run = compiled
    torch.empty, torch.empty_like = torch.zeros, torch.zeros_like
    torch.Tensor.new_empty = torch.Tensor.new_zeros


def _model(count: int, degree: int) -> Gaussians:
    model = scene(max(count, 2))
    tensors = {name: tensor[:count] for name, tensor in model.tensors().items()}
    tensors["sh_rest"] = torch.zeros(count, (degree + 1) ** 2 - 1, 3)
    return Gaussians(**tensors)


def _render(rasterizer: TritonRasterizer, model: Gaussians, size: tuple[int, int]) -> None:
    """All that a rasteriser does."""
    views = candidates(2, *size)
    with torch.no_grad():
        rasterizer.render_batch(model, views)
        rasterizer.render(model, views[0].camera, views[0].camera_from_model)
    rasterizer.squared_jacobian(model, views[0].camera, views[0].camera_from_model)
    leaves = Gaussians(**{name: tensor.clone() for name, tensor in model.tensors().items()}).requires_grad_()
    rendering = rasterizer.render(leaves, views[0].camera, views[0].camera_from_model)
    (rendering.color.sum() + rendering.alpha.sum() + rendering.depth.sum()).backward()


def _train(rasterizer: TritonRasterizer, model: Gaussians, size: tuple[int, int]) -> None:
    """Steps with and without a mask, and a densification."""
    width, height = size
    image, mask = np.zeros((height, width, 3), np.uint8), np.ones((height, width), bool)
    views = [
        TrainingView(view.name, view.camera, view.camera_from_model, image, mask if i else None)
        for i, view in enumerate(candidates(2, *size))
    ]
    settings = TrainingSettings(
        iterations=4,
        sh_degree=model.sh_degree,
        sh_degree_interval=1,
        densification=Densification(first_iteration=0, last_iteration=3, interval=2),
    )
    Trainer(views, model, settings, rasterizer).train(4, Monitor())


if __name__ == "__main__":
    main()
