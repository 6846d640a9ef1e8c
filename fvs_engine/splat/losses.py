"""The training loss: (1 − λ) · L1 + λ · (1 − SSIM), with λ = 0.2.

Source: Kerbl et al., "3D Gaussian Splatting", 2023; SSIM after Wang et al., 2004, with an 11 × 11 Gaussian
window (σ = 1.5 px), zero padding, and the mean over all pixels and channels.
"""

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
from fvs_engine.splat.triton_kernels.guard import StepGuard

SSIM_WEIGHT = 0.2
_CACHE_LINE_FLOATS = 16


def photometric_loss(
    color: Tensor, target: Tensor, ssim_weight: float = SSIM_WEIGHT, guard: StepGuard | None = None
) -> tuple[Tensor, Tensor]:
    """The loss between a rendering and a photograph, and its gradient with respect to the rendering.

    ``color`` [H, W, 3] float32, not clamped; ``target`` [H, W, 3] uint8 on the same device; returns a scalar
    and [H, W, 3]. Fused kernels: Numba's, or with the ``guard`` of a device Triton's, which set it when the
    loss is not finite.
    """
    color = color.detach().contiguous()
    if guard is not None:
        from fvs_engine.splat.triton_kernels.photometric import photometric

        return photometric(color, target, ssim_weight, guard=guard.words)
    height, width, _ = color.shape
    gradient = torch.empty_like(color)
    loss = _fused_loss(
        color.numpy().reshape(height, 3 * width),
        target.contiguous().numpy().reshape(height, 3 * width),
        gradient.numpy().reshape(height, 3 * width),
        ssim_weight,
    )
    return color.new_tensor(loss), gradient


def photometric_loss_torch(color: Tensor, target: Tensor, ssim_weight: float = SSIM_WEIGHT) -> Tensor:
    """The loss in plain torch, of any float type: the oracle; ``target`` [H, W, 3] in [0, 1]."""
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
    with torch.backends.cudnn.flags(allow_tf32=False):  # variances cancel: 10 bits of mantissa leave nothing
        rows = functional.conv2d(images, window.view(1, 1, -1, 1), padding=(REACH, 0))
        return functional.conv2d(rows, window.view(1, 1, 1, -1), padding=(0, REACH))


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
