"""The training loss: (1 − λ) · L1 + λ · (1 − SSIM), with λ = 0.2.

Source: Kerbl et al., "3D Gaussian Splatting", 2023; SSIM after Wang et al., 2004, with an 11 × 11 Gaussian
window (σ = 1.5 px), zero padding, and the mean over all pixels and channels.
"""

from typing import Any

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor
from torch.nn import functional

from fvs_engine.splat.loss_kernels import (
    C1,
    C2,
    REACH,
    gaussian_window,
    photometric_rows,
    workspace_floats,
)

SSIM_WEIGHT = 0.2
_CACHE_LINE_FLOATS = 16


def photometric_loss(color: Tensor, target: Tensor, ssim_weight: float = SSIM_WEIGHT) -> Tensor:
    """The loss between a rendering and a photograph, differentiable in the rendering.

    ``color`` [H, W, 3] float32, contiguous, not clamped; ``target`` [H, W, 3] uint8 on the same device;
    returns a scalar. One fused kernel on the CPU, convolutions elsewhere.
    """
    if color.device.type == "cpu":
        loss: Tensor = _FusedLoss.apply(color, target, ssim_weight)  # type: ignore[no-untyped-call]
        return loss
    return photometric_loss_torch(color, target.to(color.dtype) / 255, ssim_weight)


def photometric_loss_torch(color: Tensor, target: Tensor, ssim_weight: float = SSIM_WEIGHT) -> Tensor:
    """The loss in plain torch, for any device and any float type; ``target`` [H, W, 3] in [0, 1]."""
    l1 = (color - target).abs().mean()
    return (1 - ssim_weight) * l1 + ssim_weight * (1 - ssim_map(color, target).mean())


def ssim_map(a: Tensor, b: Tensor) -> Tensor:
    """SSIM at every pixel and channel of two images [H, W, 3] in [0, 1]: a tensor [3, H, W]."""
    x, y = a.permute(2, 0, 1)[:, None], b.permute(2, 0, 1)[:, None]
    mean_x, mean_y = _blur(x), _blur(y)
    variances = _blur(x * x + y * y) - mean_x**2 - mean_y**2
    covariance = _blur(x * y) - mean_x * mean_y
    luminance = (2 * mean_x * mean_y + C1) / (mean_x**2 + mean_y**2 + C1)
    structure = (2 * covariance + C2) / (variances + C2)
    return (luminance * structure)[:, 0]


def _blur(images: Tensor) -> Tensor:
    window = torch.as_tensor(gaussian_window(), dtype=images.dtype, device=images.device)
    rows = functional.conv2d(images, window.view(1, 1, -1, 1), padding=(REACH, 0))
    return functional.conv2d(rows, window.view(1, 1, 1, -1), padding=(0, REACH))


class _FusedLoss(torch.autograd.Function):
    """Value and gradient in one pass: the backward pass returns what the forward pass computed."""

    @staticmethod
    def forward(ctx: Any, color: Tensor, target: Tensor, ssim_weight: float) -> Tensor:
        height, width, _ = color.shape
        gradient = torch.empty_like(color, memory_format=torch.contiguous_format)
        loss = _fused_loss(
            color.detach().contiguous().numpy().reshape(height, 3 * width),
            target.contiguous().numpy().reshape(height, 3 * width),
            gradient.numpy().reshape(height, 3 * width),
            ssim_weight,
        )
        ctx.gradient = gradient
        return color.new_tensor(loss)

    @staticmethod
    def backward(ctx: Any, *upstream: Tensor) -> tuple[Tensor, None, None]:
        scale = float(upstream[0])
        gradient: Tensor = ctx.gradient
        return (gradient if scale == 1.0 else gradient * scale), None, None


def _fused_loss(
    color: NDArray[np.float32],
    target: NDArray[np.uint8],
    gradient: NDArray[np.float32],
    ssim_weight: float,
) -> float:
    height, row_floats = color.shape
    # The rows at the borders of bands are blurred twice, so there are no more bands than threads.
    bands = min(numba.get_num_threads(), max(1, height // (4 * REACH)))
    row_l1 = np.empty(height, np.float32)
    row_ssim = np.empty(height, np.float32)
    photometric_rows(
        color,
        target,
        gaussian_window().astype(np.float32),
        np.float32((1 - ssim_weight) / color.size),
        np.float32(ssim_weight / color.size),
        gradient,
        row_l1,
        row_ssim,
        _aligned((bands, workspace_floats(row_floats // 3))),
    )
    l1 = float(row_l1.sum(dtype=np.float64)) / color.size
    ssim = float(row_ssim.sum(dtype=np.float64)) / color.size
    return (1 - ssim_weight) * l1 + ssim_weight * (1 - ssim)


def _aligned(shape: tuple[int, int]) -> NDArray[np.float32]:
    """Uninitialised floats that start on a cache line: vector loads then never straddle two."""
    floats = np.empty(shape[0] * shape[1] + _CACHE_LINE_FLOATS, np.float32)
    skip = -(floats.ctypes.data // floats.itemsize) % _CACHE_LINE_FLOATS
    return floats[skip : skip + shape[0] * shape[1]].reshape(shape)
