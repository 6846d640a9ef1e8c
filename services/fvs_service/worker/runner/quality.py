"""The quality of a model at images that it was not trained on."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from fvs_engine.evaluate.metrics import psnr, ssim
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.splat.torch_threads import torch_threads_for
from fvs_engine.splat.views import TrainingView


@dataclass(frozen=True)
class Quality:
    """Means over images: peak signal-to-noise ratio in dB, and structural similarity."""

    psnr_db: float
    ssim: float


def measure(
    gaussians: Gaussians,
    sh_degree: int,
    views: Sequence[TrainingView],
    rasterizer: Rasterizer,
    monitor: Monitor,
) -> Quality | None:
    """The quality at ``views``; None without any. Stage ``evaluate``; raises ``Cancelled``."""
    ratios, similarities = [], []
    with torch_threads_for(rasterizer.device):
        for done, view in enumerate(views, start=1):
            monitor.check()
            render = render_color(gaussians, view, rasterizer, sh_degree=sh_degree)
            photograph = view.image.astype(np.float32) / 255
            ratios.append(psnr(render, photograph))
            similarities.append(ssim(render, photograph))
            monitor.report("evaluate", done, len(views))
    if not ratios:
        return None
    return Quality(float(np.mean(ratios)), float(np.mean(similarities)))


def spread(views: Sequence[TrainingView], most: int) -> Sequence[TrainingView]:
    """At most ``most`` of the views, evenly spaced."""
    if len(views) <= most:
        return views
    return [views[index] for index in np.linspace(0, len(views) - 1, most).round().astype(int)]
