"""Compilation of the CPU kernels, ahead of their first use."""
