"""Rasterisers: ``reference`` (plain torch, the oracle), ``cpu`` (Numba), ``cuda`` (gsplat)."""

from fvs_engine.splat.raster.interface import Rasterizer, Rendering, SquaredJacobian, SquaringRasterizer
from fvs_engine.splat.raster.selection import create_rasterizer

__all__ = ["Rasterizer", "Rendering", "SquaredJacobian", "SquaringRasterizer", "create_rasterizer"]
