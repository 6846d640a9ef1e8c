"""The quality of a model at photographs that it was not trained on."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray

from fvs_engine.monitor import Monitor
from fvs_engine.scene.scene_model import SceneModel
from fvs_engine.splat.metrics import psnr, ssim
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.views import TrainingView
from fvs_schema.stages import Stage

Image = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Comparison:
    """The render of a view, [H, W, 3] in [0, 1], and its photograph likewise; compared on ``device``."""

    view: TrainingView
    render: Image
    photograph: Image
    device: torch.device

    @classmethod
    def of(cls, model: SceneModel, view: TrainingView, rasterizer: Rasterizer) -> "Comparison":
        """Render ``view`` and compare it with its photograph."""
        photograph = view.image.astype(np.float32) / np.float32(255)
        return cls(view, model.render(view, rasterizer), photograph, rasterizer.device)

    @property
    def psnr_db(self) -> float:
        """The peak signal-to-noise ratio in dB where the photograph counts."""
        return psnr(self.render, self.photograph, self.view.mask)

    @property
    def ssim(self) -> float:
        """The structural similarity where the photograph counts."""
        return ssim(self.render, self.photograph, self.view.mask, self.device)

    @property
    def where_it_counts(self) -> tuple[Image, Image]:
        """The render and the photograph, black where the photograph does not count."""
        if self.view.mask is None:
            return self.render, self.photograph
        return self.render * self.view.mask[..., None], self.photograph * self.view.mask[..., None]


@dataclass(frozen=True)
class Quality:
    """Means over images: peak signal-to-noise ratio in dB, and structural similarity."""

    psnr_db: float
    ssim: float


def measure(
    model: SceneModel, views: Sequence[TrainingView], rasterizer: Rasterizer, monitor: Monitor
) -> Quality | None:
    """The quality at ``views``; None without any. Stage ``evaluate``; raises ``Cancelled``."""
    found = [(each.psnr_db, each.ssim) for each in comparisons(model, views, rasterizer, monitor)]
    return Quality(*np.mean(found, axis=0).tolist()) if found else None


def mean_psnr_db(
    model: SceneModel, views: Sequence[TrainingView], rasterizer: Rasterizer, monitor: Monitor
) -> float | None:
    """Like ``measure``, without the structural similarity, which takes longer than the render."""
    found = [each.psnr_db for each in comparisons(model, views, rasterizer, monitor)]
    return float(np.mean(found)) if found else None


def comparisons(
    model: SceneModel, views: Sequence[TrainingView], rasterizer: Rasterizer, monitor: Monitor
) -> Iterator[Comparison]:
    """Renders of ``views`` with their photographs, except where no pixel counts. Stage ``evaluate``."""
    with on_device(rasterizer.device):
        for done, view in enumerate(views, start=1):
            monitor.check()
            if not view.empty:
                yield Comparison.of(model, view, rasterizer)
            monitor.report(Stage.EVALUATE, done, len(views))


def evenly_spaced(views: Sequence[TrainingView], most: int) -> Sequence[TrainingView]:
    """At most ``most`` of the views, evenly spaced."""
    if len(views) <= most:
        return views
    return [views[index] for index in np.linspace(0, len(views) - 1, most).round().astype(int)]
