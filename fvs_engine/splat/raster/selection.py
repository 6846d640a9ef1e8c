"""Creation of rasterisers by name."""

import logging
from typing import get_args

import torch

from fvs_engine.choices import Backend
from fvs_engine.errors import BackendUnavailableError, InvalidInputError
from fvs_engine.monitor import Monitor
from fvs_engine.splat.raster.cuda_device import cuda_device
from fvs_engine.splat.raster.interface import Rasterizer

_log = logging.getLogger(__name__)


def create_rasterizer(name: str = "auto", monitor: Monitor | None = None) -> Rasterizer:
    """Create a backend by name; ``auto`` is ``gsplat`` where it can run, else ``cpu``.

    ``auto`` logs a warning when it cannot use a device that is there: the CPU takes many times as long. It
    will be ``triton`` once that backend was proven on a device (benchmarks/gpu).

    Raises ``InvalidInputError`` for an unknown name, ``BackendUnavailableError`` when it cannot run here.
    Backends are imported here, not at the top: each loads a compiler or a device. On its first use on a
    machine ``cpu`` compiles its kernels: stage ``compile`` of ``monitor``.
    """
    if name == "auto":
        if torch.cuda.is_available():
            try:
                return create_rasterizer("gsplat")
            except BackendUnavailableError as error:
                _log.warning("The CUDA device is not used. %s", error)
        return create_rasterizer("cpu", monitor)
    if name == "reference":
        from fvs_engine.splat.raster.reference import ReferenceRasterizer

        return ReferenceRasterizer()
    if name == "cpu":
        from fvs_engine.splat.raster.cpu import CpuRasterizer

        return CpuRasterizer(monitor)
    if name in {"triton", "gsplat"}:
        device = cuda_device()
        if name == "triton":
            from fvs_engine.splat.raster.triton import TritonRasterizer

            return TritonRasterizer(device)
        from fvs_engine.splat.raster.gsplat import GsplatRasterizer

        return GsplatRasterizer(device)
    raise InvalidInputError(
        f"There is no rasteriser {name!r}.", hint=f"Choose one of {', '.join(get_args(Backend))}."
    )
