"""Adaptive density control: Gaussians are cloned, split and removed where the loss requires it.

Source: Kerbl et al., 2023, section 5.2: a large gradient of a projected centre shows where the model is
wrong; there a small Gaussian is cloned, a large one split in two; transparent and oversized ones are removed;
opacities are reset at intervals so that useless ones can fade.
"""

import math

import numba
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.special import logit
from torch import Tensor

from fvs_engine.compilation.kernels import parallel_kernel
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.optimiser import GaussianAdam
from fvs_engine.splat.raster.interface import Rendering
from fvs_engine.splat.raster.reference_projection import rotation_matrices
from fvs_engine.splat.settings import Densification
from fvs_engine.splat.triton_kernels.guard import StepGuard

SPLIT_CHILDREN = 2
SPLIT_SHRINK = 0.8 * SPLIT_CHILDREN
RESET_OPACITY = 0.01


class GradientStatistics:
    """Accumulated gradients of the projected centres over the views that saw them.

    ``total`` [N]: Σ ‖∂loss/∂centre‖ in normalised device coordinates; ``views`` [N]: how many.
    """

    def __init__(self, count: int, device: torch.device) -> None:
        self.total = torch.zeros(count, device=device)
        self.views = torch.zeros(count, device=device)

    def add(self, rendering: Rendering, guard: StepGuard | None = None) -> None:
        """Count one backward pass through ``rendering``; with the ``guard`` of a device, unless it is set."""
        height, width, _ = rendering.color.shape
        gradient = rendering.screen_means.grad if rendering.screen_means is not None else None
        if gradient is None:
            return
        if guard is not None:
            from fvs_engine.splat.triton_kernels.adam import add_gradients

            radii_px = rendering.radii_px.detach()
            add_gradients(gradient, radii_px, (width, height), self.total, self.views, guard.words)
            return
        _add_gradients(
            gradient.numpy(),
            rendering.radii_px.detach().numpy(),
            np.float32(width / 2),
            np.float32(height / 2),
            self.total.numpy(),
            self.views.numpy(),
        )

    def mean(self) -> Tensor:
        """The mean norm per Gaussian [N]; 0 where no view saw it."""
        return self.total / self.views.clamp(min=1)


def is_due(rules: Densification, iteration: int) -> bool:
    """Whether Gaussians are added and removed after this iteration."""
    return (
        rules.first_iteration < iteration <= rules.last_iteration
        and iteration % rules.interval == rules.phase % rules.interval
    )


def reset_is_due(rules: Densification, iteration: int) -> bool:
    """Whether opacities are reset after this iteration: never so late that they could not recover."""
    return (
        0 < iteration < rules.last_iteration
        and iteration % rules.opacity_reset_interval == 0
        and iteration + rules.interval <= rules.last_iteration
    )


@torch.no_grad()
def densify(
    gaussians: Gaussians,
    optimiser: GaussianAdam,
    statistics: GradientStatistics,
    rules: Densification,
    *,
    extent: float,
    max_gaussians: int,
    prune_large: bool,
    generator: torch.Generator,
) -> Gaussians:
    """Clone, split and prune; return the new Gaussians, with the optimiser's moments in step.

    ``generator`` (on the CPU) samples the positions of the halves of a split. The count never exceeds
    ``max_gaussians`` by growth: at the cap, those with the largest gradients are taken.
    """
    grown, doomed = _grow(gaussians, optimiser, statistics, rules, extent, max_gaussians, generator)
    useless = torch.sigmoid(grown.opacity_logits) < rules.prune_opacity
    if prune_large:
        useless |= grown.log_scales.amax(dim=1) > math.log(rules.prune_extent * extent)
    useless[doomed] = True
    if useless.all():
        useless[grown.opacity_logits.argmax()] = False
    kept = torch.nonzero(~useless)[:, 0]
    optimiser.keep(kept, added=0)
    return Gaussians(**{name: tensor[kept] for name, tensor in grown.tensors().items()})


def _grow(
    gaussians: Gaussians,
    optimiser: GaussianAdam,
    statistics: GradientStatistics,
    rules: Densification,
    extent: float,
    max_gaussians: int,
    generator: torch.Generator,
) -> tuple[Gaussians, Tensor]:
    """Append clones and halves; also return the indices of those that their halves replace."""
    chosen = _worst(statistics.mean(), rules.gradient_threshold, max_gaussians - len(gaussians))
    large = gaussians.log_scales[chosen].amax(dim=1) > math.log(rules.dense_extent * extent)
    cloned, split = chosen[~large], chosen[large]
    parents = split.repeat(SPLIT_CHILDREN)
    source = torch.cat([cloned, parents])
    new = {name: tensor[source] for name, tensor in gaussians.tensors().items()}
    halves = slice(len(cloned), None)
    noise = torch.randn((len(parents), 3), generator=generator).to(gaussians.device)
    offsets = noise * torch.exp(new["log_scales"][halves])
    rotations = rotation_matrices(new["quaternions_wxyz"][halves])
    new["means"][halves] += (rotations @ offsets[:, :, None])[:, :, 0]
    new["log_scales"][halves] -= math.log(SPLIT_SHRINK)
    everyone = torch.arange(len(gaussians), device=gaussians.device)
    optimiser.keep(everyone, added=len(source))
    grown = {name: torch.cat([tensor, new[name]]) for name, tensor in gaussians.tensors().items()}
    return Gaussians(**grown), split


def _worst(gradients: Tensor, threshold: float, room: int) -> Tensor:
    """Indices, ascending, of gradients from ``threshold`` on; of more than ``room``, the largest."""
    over = torch.nonzero(gradients >= threshold)[:, 0]
    if len(over) <= room:
        return over
    order = torch.argsort(gradients[over], descending=True, stable=True)
    return over[order[: max(0, room)]].sort().values


@torch.no_grad()
def reset_opacities(gaussians: Gaussians, optimiser: GaussianAdam) -> None:
    """Lower every opacity to at most 0.01, in place; those that the images need will recover."""
    gaussians.opacity_logits.clamp_(max=float(logit(RESET_OPACITY)))
    optimiser.forget("opacity_logits")


@parallel_kernel
def _add_gradients(
    gradient: NDArray[np.float32],
    radii: NDArray[np.float32],
    half_width: np.float32,
    half_height: np.float32,
    total: NDArray[np.float32],
    views: NDArray[np.float32],
) -> None:
    for i in numba.prange(gradient.shape[0]):
        if radii[i] > 0:
            gx = gradient[i, 0] * half_width
            gy = gradient[i, 1] * half_height
            total[i] += np.sqrt(gx * gx + gy * gy)
            views[i] += np.float32(1)
