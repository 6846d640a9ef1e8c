"""Numba kernels of the CPU rasteriser."""
