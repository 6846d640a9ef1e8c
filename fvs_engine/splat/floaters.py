"""Floaters: Gaussians in the air near a camera that one photograph alone shows.

Training puts them where only one photograph looks: they explain what it shows, and hang before everything
from other poses. Their support is the weight with which renders blend them into the views trained on.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from fvs_engine.images.masks import Mask, reduced_mask
from fvs_engine.images.pixels import reduced_size
from fvs_engine.monitor import Monitor
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.on_device import on_device
from fvs_engine.splat.raster import Rasterizer
from fvs_engine.splat.spherical_harmonics import SH_C0
from fvs_engine.views import PinholeView, View
from fvs_schema.findings import Finding, FindingCode, Severity
from fvs_schema.stages import Stage

LONG_SIDE_PX = 400
"""The size of the renders in which weights are measured: 0.1 s per view and core."""
ALONE = 0.5
"""One photograph alone shows a Gaussian of whose weight it has more than this: more than all others together.

At 0.8, three quarters of what the removal gains are lost (benchmarks/results/training.md)."""
UNSEEN_PX = 1.0
"""Photographs that show less of a Gaussian than this, all together, do not show it."""


def without_floaters(
    gaussians: Gaussians,
    views: Sequence[PinholeView],
    points: NDArray[np.float64],
    rasterizer: Rasterizer,
    monitor: Monitor,
    masks: Mapping[str, Mask] | None = None,
) -> Gaussians:
    """The Gaussians that are no floaters; a note says how many were. Arguments as of ``find_floaters``."""
    floaters = find_floaters(gaussians, views, points, rasterizer, monitor, masks)
    count = int(floaters.sum())
    if not count:
        return gaussians
    monitor.warn(
        Finding.of(FindingCode.FLOATERS_REMOVED, severity=Severity.NOTE, floaters=count, of=len(gaussians))
    )
    return Gaussians(**{name: tensor[~floaters] for name, tensor in gaussians.tensors().items()})


def find_floaters(
    gaussians: Gaussians,
    views: Sequence[PinholeView],
    points: NDArray[np.float64],
    rasterizer: Rasterizer,
    monitor: Monitor,
    masks: Mapping[str, Mask] | None = None,
) -> Tensor:
    """Which Gaussians are floaters, bool [N].

    They are in the air: nearer to a camera than to any of the ``points`` [P, 3] that structure from motion
    found. And fewer than two photographs show them: one has more than ``ALONE`` of their weight, or all
    together show nothing. ``views`` are those that the Gaussians were trained on. Where the ``masks``, by the
    views' names, are False, nothing is shown. Stage ``cleaning``; raises ``Cancelled``.
    """
    masks = masks or {}
    means = gaussians.means.detach()
    largest = torch.zeros(len(gaussians), device=means.device)
    total = torch.zeros_like(largest)
    with on_device(rasterizer.device):
        for done, view in enumerate(views, start=1):
            monitor.check()
            size = reduced_size(view.camera.width, view.camera.height, LONG_SIDE_PX)
            small = View(view.name, view.camera.resized(*size), view.camera_from_model)
            mask = masks.get(view.name)
            mask = None if mask is None else reduced_mask(mask, size)
            weights = blending_weights(gaussians, small, rasterizer, mask)
            total += weights
            largest = torch.maximum(largest, weights)
            monitor.report(Stage.CLEANING, done, len(views))
    air = torch.from_numpy(_in_the_air(means.cpu().numpy().astype(np.float64), views, points))
    return air.to(means.device) & ((largest > ALONE * total) | (total < UNSEEN_PX))


def blending_weights(
    gaussians: Gaussians, view: PinholeView, rasterizer: Rasterizer, mask: Mask | None = None
) -> Tensor:
    """Σ alpha · transmittance of every Gaussian over the pixels of a view, in px [N].

    With a ``mask`` [H, W] over those where it is True. A colour is linear in its constant harmonic, so the
    weight is a gradient: every rasteriser has it.
    """
    grey = torch.zeros_like(gaussians.sh_dc).requires_grad_()
    parameters = {name: tensor.detach() for name, tensor in gaussians.tensors().items()}
    model = Gaussians(**parameters | {"sh_dc": grey, "sh_rest": grey.new_zeros(len(gaussians), 0, 3)})
    with torch.enable_grad():
        color = rasterizer.render(model, view.camera, view.camera_from_model, sh_degree=0).color
        shown = color[..., 0]
        if mask is not None:
            shown = shown * torch.from_numpy(mask).to(shown)
        (gradient,) = torch.autograd.grad(shown.sum(), grey)
    return gradient[:, 0] / SH_C0


def _in_the_air(
    means: NDArray[np.float64], views: Sequence[PinholeView], points: NDArray[np.float64]
) -> NDArray[np.bool_]:
    """Which ``means`` [N, 3] are nearer to a camera than to any point; none where there is no point."""
    if not len(points) or not views:
        return np.zeros(len(means), dtype=bool)
    from scipy.spatial import cKDTree  # slow to import

    to_camera, _ = cKDTree(np.stack([view.centre for view in views])).query(means)
    to_point, _ = cKDTree(points).query(means)
    return np.asarray(to_camera < to_point)
