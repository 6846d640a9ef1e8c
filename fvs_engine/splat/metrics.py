"""Image quality metrics: PSNR and SSIM."""

import numpy as np
import torch
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.images.masks import Mask
from fvs_engine.splat.losses import ssim_map

CPU = torch.device("cpu")
SMALLEST_ERROR = 1e-10
"""The mean squared error below which two images count as equal: PSNR is at most 100 dB."""


def psnr(a: ArrayLike, b: ArrayLike, mask: Mask | None = None) -> float:
    """Peak signal-to-noise ratio in dB of two images [H, W, 3] in [0, 1] (clamped to it): 0 to 100.

    Over the pixels where ``mask`` [H, W] is True; None: over all. Raises ``InvalidInputError`` where it is
    never True.
    """
    x, y = _pair(a, b, mask)
    if mask is not None:
        x, y = x[mask], y[mask]
    return float(-10 * np.log10(max(float(np.mean((x - y) ** 2)), SMALLEST_ERROR)))


def ssim(a: ArrayLike, b: ArrayLike, mask: Mask | None = None, device: torch.device = CPU) -> float:
    """Structural similarity of two images [H, W, 3] in [0, 1] (clamped to it): 1 when they are equal.

    Gaussian window of 11 × 11 px, σ = 1.5 px, zero padding, mean over pixels and channels: the variant
    that papers on Gaussian splatting report. Over the pixels where ``mask`` [H, W] is True, the others being
    black in both images; None: over all. Computed on ``device``. Raises ``InvalidInputError`` where the mask
    is never True.
    """
    x, y = _pair(a, b, mask)
    if mask is not None:
        x, y = x * mask[..., None], y * mask[..., None]
    # float32: torch's convolutions of float64 take several times as long, for a sixth digit that is not shown
    images = (torch.from_numpy(image.astype(np.float32)).to(device) for image in (x, y))
    found = ssim_map(*images)
    return float((found if mask is None else found[:, torch.from_numpy(mask).to(device)]).mean())


def _pair(a: ArrayLike, b: ArrayLike, mask: Mask | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    x, y = np.asarray(a, np.float64), np.asarray(b, np.float64)
    if x.shape != y.shape or x.ndim != 3 or x.shape[2] != 3 or x.size == 0:
        raise InvalidInputError(
            f"Images of shapes {x.shape} and {y.shape} cannot be compared.",
            hint="Both must be [height, width, 3].",
        )
    if mask is not None and not mask.any():
        raise InvalidInputError(
            "The mask leaves out every pixel, so the images cannot be compared.", hint="Leave out the image."
        )
    return np.clip(x, 0, 1), np.clip(y, 0, 1)
