"""Renders as arrays."""

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.views import PinholeView


def render_color(
    gaussians: Gaussians,
    view: PinholeView,
    rasterizer: Rasterizer,
    *,
    sh_degree: int | None = None,
) -> NDArray[np.float32]:
    """The model rendered at a view, on black: [H, W, 3] in [0, 1]; ``sh_degree``: None is the model's own."""
    with torch.no_grad():
        rendering = rasterizer.render(gaussians, view.camera, view.camera_from_model, sh_degree=sh_degree)
    return np.asarray(rendering.color.clamp(0.0, 1.0).cpu().numpy(), dtype=np.float32)


def to_pixels(color: NDArray[np.floating]) -> NDArray[np.uint8]:
    """Colours in [0, 1], rounded to 8 bits."""
    return np.round(color * 255.0).astype(np.uint8)


def log_magnitude(image: NDArray[np.floating]) -> NDArray[np.float32]:
    """Ln |F| [H, W] of a render [H, W, 3], mean over its channels, with 0 cycles/px in the middle.

    −inf where a coefficient is zero; pixels that are not finite count as black.
    """
    clean = np.clip(np.nan_to_num(image.astype(np.float32)), 0.0, 1.0)
    magnitude = np.abs(np.fft.fft2(clean, axes=(0, 1)))
    with np.errstate(divide="ignore"):
        return np.fft.fftshift(np.log(magnitude).mean(axis=2)).astype(np.float32)
