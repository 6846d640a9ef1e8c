"""The interface of rasterisers; the rules that all keep are in ``splat.conventions``."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.triton_kernels.guard import StepGuard
from fvs_engine.views import PinholeView

GPU_BATCH_BYTES = 1 << 32
"""``Rasterizer.batch_bytes`` on a GPU: more views at once are not faster."""


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
    """One backend. Stateless between calls; safe to call from several threads.

    ``steps_on_device``: training with it runs Triton's kernels for the loss and Adam, not Numba's, and the
    host does not wait for its steps (``triton_kernels.guard``).
    ``batch_bytes``: memory for the views that are rendered and scored at once; with 0 it is one view.
    """

    name: str
    device: torch.device
    steps_on_device: bool
    batch_bytes: int

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


@runtime_checkable
class BatchRasterizer(Rasterizer, Protocol):
    """A backend that renders many views at once."""

    def render_batch(
        self, gaussians: Gaussians, views: Sequence[PinholeView], *, sh_degree: int | None = None
    ) -> tuple[Tensor, Tensor]:
        """Colours [B, H, W, 3] and alphas [B, H, W] of views of one size, as ``render`` has them."""
        ...


@runtime_checkable
class GuardedRasterizer(Rasterizer, Protocol):
    """A backend that renders for a step of training without waiting for the device."""

    def render_guarded(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        guard: StepGuard,
        *,
        sh_degree: int | None = None,
    ) -> Rendering:
        """As ``render``, without depth (zeros); an image with too little room for its hits sets ``guard``."""
        ...
