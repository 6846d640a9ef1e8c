"""Rasterisers: ``reference`` (plain torch, the oracle), ``cpu`` (Numba), ``cuda`` (gsplat)."""

from fvs_engine.splat.raster.interface import Rasterizer, Rendering
from fvs_engine.splat.raster.selection import create_rasterizer

__all__ = ["Rasterizer", "Rendering", "create_rasterizer"]
