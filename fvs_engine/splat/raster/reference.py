"""Reference rasteriser: tiles in plain torch, differentiated by autograd; slow, and short enough to verify.

It runs in the dtype of the Gaussians (float64 passes gradcheck).
"""

import torch
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.conventions import ALPHA_MAX, ALPHA_MIN, TRANSMITTANCE_MIN
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.raster.interface import Rendering
from fvs_engine.splat.raster.reference_projection import ScreenSplats, project

TILE_PX = 16


class ReferenceRasterizer:
    """Plain torch; the backend that all others are tested against."""

    name = "reference"
    steps_on_device = False
    batch_bytes = 0
    device = torch.device("cpu")

    def render(
        self,
        gaussians: Gaussians,
        camera: PinholeCamera,
        camera_from_model: RigidTransform,
        *,
        sh_degree: int | None = None,
    ) -> Rendering:
        """See ``Rasterizer.render``."""
        degree = gaussians.degree_in_use(sh_degree)
        splats = project(gaussians, camera, camera_from_model, degree)
        screen_means = splats.centers
        if screen_means.requires_grad:
            screen_means.retain_grad()

        order = torch.argsort(splats.depths.detach(), stable=True)
        order = order[splats.visible[order]]
        lower = (splats.centers - splats.extents_px).detach()[order]
        upper = (splats.centers + splats.extents_px).detach()[order]
        rows = []
        for top in range(0, camera.height, TILE_PX):
            bottom = min(top + TILE_PX, camera.height)
            in_band = (upper[:, 1] > top) & (lower[:, 1] < bottom)
            row = []
            for left in range(0, camera.width, TILE_PX):
                right = min(left + TILE_PX, camera.width)
                hit = order[in_band & (upper[:, 0] > left) & (lower[:, 0] < right)]
                row.append(_blend(splats, hit, (left, top, right, bottom)))
            rows.append(torch.cat(row, dim=1))
        image = torch.cat(rows, dim=0)

        color, alpha, depth = image[..., :3], image[..., 3], image[..., 4]
        radii = torch.where(splats.visible, splats.extents_px.amax(-1), splats.extents_px.new_zeros(()))
        return Rendering(color, alpha, depth, radii, screen_means if screen_means.requires_grad else None)


def _blend(splats: ScreenSplats, hit: Tensor, box: tuple[int, int, int, int]) -> Tensor:
    """Blend the splats ``hit``, ordered front to back, in a box of pixels: [h, w, 5] colour, alpha, depth."""
    left, top, right, bottom = box
    dtype, device = splats.centers.dtype, splats.centers.device
    xs = torch.arange(left, right, dtype=dtype, device=device) + 0.5
    ys = torch.arange(top, bottom, dtype=dtype, device=device) + 0.5
    dx = xs[None, :, None] - splats.centers[hit, 0]
    dy = ys[:, None, None] - splats.centers[hit, 1]
    a, k, b = splats.factors[hit].unbind(-1)
    exponent = (a * (dx - k * dy)) ** 2 + (b * dy) ** 2
    alphas = (splats.opacities[hit] * torch.exp(-exponent)).clamp_max(ALPHA_MAX)
    alphas = torch.where(alphas >= ALPHA_MIN, alphas, torch.zeros_like(alphas))

    after = torch.cumprod(1 - alphas, dim=-1)
    before = torch.cat([torch.ones_like(after[..., :1]), after[..., :-1]], dim=-1)
    # Transmittance only falls, so "finished" is a suffix of the list.
    weights = torch.where(after > TRANSMITTANCE_MIN, alphas * before, torch.zeros_like(alphas))
    values = torch.cat([splats.colors[hit], torch.ones_like(a)[:, None], splats.depths[hit][:, None]], dim=-1)
    return weights @ values
