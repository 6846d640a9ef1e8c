"""The quality of a model at photographs that it was not trained on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.metrics import psnr, ssim
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.torch_threads import torch_threads_for
from fvs_engine.splat.views import TrainingView
from fvs_schema.stages import Stage

Image = NDArray[np.float32]


@dataclass(frozen=True)
class Quality:
    """Means over images: peak signal-to-noise ratio in dB, and structural similarity."""

    psnr_db: float
    ssim: float


def measure(
    model: SceneModel, views: Sequence[TrainingView], rasterizer: Rasterizer, monitor: Monitor
) -> Quality | None:
    """The quality at ``views``; None without any. Stage ``evaluate``; raises ``Cancelled``."""
    pairs = renders_of(model, views, rasterizer, monitor)
    found = [(psnr(render, photograph), ssim(render, photograph)) for render, photograph in pairs]
    return Quality(*np.mean(found, axis=0).tolist()) if found else None


def mean_psnr_db(
    model: SceneModel, views: Sequence[TrainingView], rasterizer: Rasterizer, monitor: Monitor
) -> float | None:
    """Like ``measure``, without the structural similarity, which takes longer than the render."""
    pairs = renders_of(model, views, rasterizer, monitor)
    found = [psnr(render, photograph) for render, photograph in pairs]
    return float(np.mean(found)) if found else None


def renders_of(
    model: SceneModel, views: Sequence[TrainingView], rasterizer: Rasterizer, monitor: Monitor
) -> Iterator[tuple[Image, Image]]:
    """Renders of ``views`` and their photographs, [H, W, 3] in [0, 1]. Stage ``evaluate``."""
    with torch_threads_for(rasterizer.device):
        for done, view in enumerate(views, start=1):
            monitor.check()
            yield model.render(view, rasterizer), view.image.astype(np.float32) / np.float32(255)
            monitor.report(Stage.EVALUATE, done, len(views))


def evenly_spaced(views: Sequence[TrainingView], most: int) -> Sequence[TrainingView]:
    """At most ``most`` of the views, evenly spaced."""
    if len(views) <= most:
        return views
    return [views[index] for index in np.linspace(0, len(views) - 1, most).round().astype(int)]
