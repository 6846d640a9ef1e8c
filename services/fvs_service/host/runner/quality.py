"""The quality of a model at images that it was not trained on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.metrics import psnr, ssim
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.render import render_color
from fvs_engine.splat.torch_threads import torch_threads_for
from fvs_engine.splat.views import TrainingView
from fvs_schema.stages import Stage


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
    pairs = _rendered(gaussians, sh_degree, views, rasterizer, monitor)
    found = [(psnr(render, photograph), ssim(render, photograph)) for render, photograph in pairs]
    return Quality(*np.mean(found, axis=0).tolist()) if found else None


def psnr_db(
    gaussians: Gaussians,
    sh_degree: int,
    views: Sequence[TrainingView],
    rasterizer: Rasterizer,
    monitor: Monitor,
) -> float | None:
    """Like ``measure``, without the structural similarity, which takes longer than the render."""
    pairs = _rendered(gaussians, sh_degree, views, rasterizer, monitor)
    found = [psnr(render, photograph) for render, photograph in pairs]
    return float(np.mean(found)) if found else None


def _rendered(
    gaussians: Gaussians,
    sh_degree: int,
    views: Sequence[TrainingView],
    rasterizer: Rasterizer,
    monitor: Monitor,
) -> Iterator[tuple[NDArray[np.float32], NDArray[np.float32]]]:
    """Renders of ``views`` and their photographs, [H, W, 3] in [0, 1]."""
    with torch_threads_for(rasterizer.device):
        for done, view in enumerate(views, start=1):
            monitor.check()
            render = render_color(gaussians, view, rasterizer, sh_degree=sh_degree)
            yield render, np.asarray(view.image / 255, dtype=np.float32)
            monitor.report(Stage.EVALUATE, done, len(views))


def spread(views: Sequence[TrainingView], most: int) -> Sequence[TrainingView]:
    """At most ``most`` of the views, evenly spaced."""
    if len(views) <= most:
        return views
    return [views[index] for index in np.linspace(0, len(views) - 1, most).round().astype(int)]
