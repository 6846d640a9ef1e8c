"""The interface of rasterisers.

Conventions shared by all backends, so that they can be tested against one another (gsplat's "classic" mode):

* a Gaussian is culled when its depth is < ``NEAR_PLANE`` or its screen ellipse misses the image;
* the 2D covariance gets ``BLUR_PX2`` added to its diagonal (the low-pass of the 3DGS paper);
* the ellipse extends to ``3.33 σ`` or to where alpha falls under 1/255, whichever is nearer;
* a splat's alpha is min(0.999, opacity · exp(−½ dᵀ Σ⁻¹ d)), skipped under 1/255;
* a pixel is finished before the splat that would take its transmittance under ``TRANSMITTANCE_MIN``;
* splats are blended front to back by the depth of their centres; ties by index.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import torch
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.gaussians import Gaussians

NEAR_PLANE = 0.01
BLUR_PX2 = 0.3
ALPHA_MIN = 1.0 / 255.0
ALPHA_MAX = 0.999
TRANSMITTANCE_MIN = 1e-4


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
