"""The spectrum of a render, for display."""

import numpy as np
from numpy.typing import NDArray


def log_magnitude(image: NDArray[np.floating]) -> NDArray[np.float32]:
    """Ln |F| [H, W] of a render [H, W, 3], mean over its channels, with 0 cycles/px in the middle.

    −inf where a coefficient is zero; pixels that are not finite count as black.
    """
    clean = np.clip(np.nan_to_num(image.astype(np.float32)), 0.0, 1.0)
    magnitude = np.abs(np.fft.fft2(clean, axes=(0, 1)))
    with np.errstate(divide="ignore"):
        return np.fft.fftshift(np.log(magnitude).mean(axis=2)).astype(np.float32)
