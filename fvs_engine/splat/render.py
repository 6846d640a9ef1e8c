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
