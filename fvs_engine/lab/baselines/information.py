"""The information of a view about every parameter of the model: the diagonal of its Fisher information.

With unit noise on every colour, the information of an image about the parameters is JᵀJ; of it only the
diagonal is kept. Rotations are left out, as in FisherRF: those of round Gaussians have no effect.
"""

from dataclasses import dataclass

import torch
from torch import Tensor

from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster import Rasterizer, SquaringRasterizer
from fvs_engine.splat.settings import sh_coefficient_count
from fvs_engine.splat.views import counted_pixels
from fvs_engine.views import PinholeView

PROBES = 4
"""Backward passes per view where the diagonal is estimated; see ``estimated_information``."""

_PARAMETERS = ("means", "log_scales", "opacity_logits", "sh_dc", "sh_rest")


@dataclass(frozen=True, eq=False)
class ViewInformation:
    """``diagonal`` [N, P] ≥ 0, one column per parameter of a Gaussian; ``coverage``, the mean alpha."""

    diagonal: Tensor
    coverage: float


def view_information(
    gaussians: Gaussians,
    view: PinholeView,
    rasterizer: Rasterizer,
    *,
    sh_degree: int | None = None,
    seed: int = 0,
    probes: int = PROBES,
) -> ViewInformation:
    """The information of one view: exact where the rasteriser supports it, else estimated.

    Masked pixels have none, and a masked view is estimated. The exact way (``SquaringRasterizer``) costs as
    much as one gradient and needs no ``seed``.
    Source: Jiang et al., "FisherRF", 2024, for the diagonal; ``estimated_information`` for the other way.
    """
    if not isinstance(rasterizer, SquaringRasterizer) or counted_pixels(view) is not None:
        return estimated_information(
            gaussians, view, rasterizer, sh_degree=sh_degree, seed=seed, probes=probes
        )
    found = rasterizer.squared_jacobian(gaussians, view.camera, view.camera_from_model, sh_degree=sh_degree)
    parts = [getattr(found, name) for name in _PARAMETERS]
    return ViewInformation(_columns(parts, gaussians, sh_degree), float(found.alpha.mean()))


def estimated_information(
    gaussians: Gaussians,
    view: PinholeView,
    rasterizer: Rasterizer,
    *,
    sh_degree: int | None = None,
    seed: int = 0,
    probes: int = PROBES,
) -> ViewInformation:
    """The information of one view on any rasteriser, estimated without bias by ``probes`` backward passes.

    With signs z = ±1 at random for every pixel and channel, E[(Jᵀz)²] is the diagonal of JᵀJ (Bekas et
    al., "An estimator for the diagonal of a matrix", 2007). A single entry is off by √(2 / probes) of its
    value; sums over thousands of Gaussians by far less. ``seed`` decides the signs: others on each device.
    """
    leaves = Gaussians(**{name: tensor.detach() for name, tensor in gaussians.tensors().items()})
    inputs = [getattr(leaves, name).requires_grad_() for name in _PARAMETERS]
    with torch.enable_grad():
        rendering = rasterizer.render(leaves, view.camera, view.camera_from_model, sh_degree=sh_degree)
    color, mask = rendering.color, counted_pixels(view)
    counts = None if mask is None else torch.from_numpy(mask)[..., None].to(color)
    generator = torch.Generator(color.device).manual_seed(seed)
    sums = [torch.zeros_like(tensor) for tensor in inputs]
    for done in range(1, probes + 1):
        signs = torch.randint(0, 2, color.shape, generator=generator, device=color.device)
        signs = signs.mul_(2).sub_(1).to(color)
        signs = signs if counts is None else signs * counts
        gradients = torch.autograd.grad(
            color, inputs, signs, retain_graph=done < probes, allow_unused=True, materialize_grads=True
        )
        for total, gradient in zip(sums, gradients, strict=True):
            total += gradient.square() / probes
    return ViewInformation(_columns(sums, gaussians, sh_degree), float(rendering.alpha.detach().mean()))


def _columns(parts: list[Tensor], gaussians: Gaussians, sh_degree: int | None) -> Tensor:
    """All parameters of a Gaussian in one row, without the harmonics that the render did not use."""
    *others, sh_rest = parts
    used = sh_rest[:, : sh_coefficient_count(gaussians.degree_in_use(sh_degree)) - 1]
    return torch.cat([part.flatten(1) if part.ndim > 1 else part[:, None] for part in (*others, used)], dim=1)
