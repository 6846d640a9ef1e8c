"""Rasterisers: ``reference`` (plain torch, the oracle), ``cpu`` (Numba), ``triton`` and ``gsplat`` (CUDA)."""

from fvs_engine.splat.raster.interface import (
    BatchRasterizer,
    Rasterizer,
    Rendering,
    SquaredJacobian,
    SquaringRasterizer,
)
from fvs_engine.splat.raster.selection import create_rasterizer

__all__ = [
    "BatchRasterizer",
    "Rasterizer",
    "Rendering",
    "SquaredJacobian",
    "SquaringRasterizer",
    "create_rasterizer",
]
