"""Triton kernels of the GPU: projection, binning, blending, the loss, Adam, and the median of a spectrum."""
