"""The interface of rasterisers; the rules that all keep are in ``splat.conventions``."""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.gaussians import Gaussians


class HasGradient(Protocol):
    """Something that holds a gradient after a backward pass; a tensor, for most backends."""

    @property
    def grad(self) -> Tensor | None:
        """The gradient, or None before a backward pass."""
        ...


@dataclass
class Rendering:
    """The result of rendering a view.

    ``color`` [H, W, 3], on black and not clamped; ``alpha`` [H, W] in [0, 1]; ``depth`` [H, W], the sum of
    weight · depth of the centres along z (divide by alpha for the expected depth). For every Gaussian:
    ``radii_px`` [N], half the larger side of its screen box, 0 where it was culled; and ``screen_means``,
    whose ``.grad`` [N, 2] after a backward pass is the gradient with respect to the projected centres in
    px (None when gradients are off).
    """

    color: Tensor
    alpha: Tensor
    depth: Tensor
    radii_px: Tensor
    screen_means: HasGradient | None


class Rasterizer(Protocol):
    """One backend. Stateless between calls; safe to call from several threads."""

    name: str
    device: torch.device

    def render(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        *,
        sh_degree: int | None = None,
    ) -> Rendering:
        """Render; differentiable in every tensor of ``gaussians`` that requires gradients.

        ``sh_degree``: use only this many degrees (default: all that are stored).
        """
        ...


@dataclass
class SquaredJacobian:
    """Squared derivatives of an image by parameter: Σ (∂ colour / ∂ parameter)² over pixels and channels.

    The diagonal of JᵀJ: ``means`` [N, 3] (at a fixed direction of view: spherical harmonics turn with a
    Gaussian that moves, which is not counted), ``log_scales`` [N, 3], ``opacity_logits`` [N], ``sh_dc``
    [N, 3] and ``sh_rest`` [N, K − 1, 3], on black. ``alpha`` [H, W] of the same rendering.
    """

    means: Tensor
    log_scales: Tensor
    opacity_logits: Tensor
    sh_dc: Tensor
    sh_rest: Tensor
    alpha: Tensor


@runtime_checkable
class SquaringRasterizer(Rasterizer, Protocol):
    """A backend that computes the squared Jacobian exactly, in one pass."""

    def squared_jacobian(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        *,
        sh_degree: int | None = None,
    ) -> SquaredJacobian:
        """The squared Jacobian of ``render`` with the same arguments; not differentiable."""
        ...
