"""From 3D Gaussians to screen ellipses, in plain torch: the oracle's first half.

The screen covariance is kept as the two factors that the blending needs, which is exact where the usual
inverse 2×2 matrix cancels (huge, needle-thin splats): with d = pixel − centre,

    ½ dᵀ Σ⁻¹ d = (A (d_x − k d_y))² + (B d_y)²,

k = Σ_xy / Σ_yy, B = √½ / √Σ_yy, A = √½ / √(det Σ / Σ_yy). With Σ = M Mᵀ + εI and M [2, 3] with rows m₁, m₂,
det Σ = |m₁ × m₂|² + ε (|m₁|² + |m₂|²) + ε²: positive terms only (Cauchy-Binet).

Source of the projection: Zwicker et al., "EWA Splatting", 2002; Kerbl et al., 2023.
"""

import math
from dataclasses import dataclass

import torch
from torch import Tensor

from fvs_engine.geometry import PinholeCamera, RigidTransform
from fvs_engine.splat.conventions import ALPHA_MIN, BLUR_PX2, NEAR_PLANE
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.spherical_harmonics import sh_colors


@dataclass
class ScreenSplats:
    """N projected Gaussians; entries of culled ones (``visible`` False) mean nothing.

    ``centers`` [N, 2] px, ``depths`` [N], ``factors`` [N, 3] = (A, k, B), ``opacities`` [N], ``colors``
    [N, 3], ``extents_px`` [N, 2] half sides of the screen box, ``visible`` [N].
    """

    centers: Tensor
    depths: Tensor
    factors: Tensor
    opacities: Tensor
    colors: Tensor
    extents_px: Tensor
    visible: Tensor


def rotation_matrices(quaternions_wxyz: Tensor) -> Tensor:
    """Rotations [N, 3, 3] of quaternions [N, 4] of any length but zero."""
    w, x, y, z = torch.nn.functional.normalize(quaternions_wxyz, dim=-1).unbind(-1)
    rows = [
        1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y),
        2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x),
        2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y),
    ]  # fmt: skip
    return torch.stack(rows, dim=-1).reshape(-1, 3, 3)


def project(
    gaussians: Gaussians, camera: PinholeCamera, camera_from_model: RigidTransform, sh_degree: int
) -> ScreenSplats:
    """Project every Gaussian; differentiable."""
    means = gaussians.means
    rotation = torch.as_tensor(camera_from_model.rotation, dtype=means.dtype, device=means.device)
    translation = torch.as_tensor(camera_from_model.translation, dtype=means.dtype, device=means.device)
    x, y, depths = (means @ rotation.T + translation).unbind(-1)
    in_front = depths >= NEAR_PLANE
    z = torch.where(in_front, depths, torch.ones_like(depths))

    # The affine approximation degrades far outside the image: its direction is held at the border.
    margin_x, margin_y = 0.15 * camera.width / camera.fx, 0.15 * camera.height / camera.fy
    u = (x / z).clamp(-camera.cx / camera.fx - margin_x, (camera.width - camera.cx) / camera.fx + margin_x)
    v = (y / z).clamp(-camera.cy / camera.fy - margin_y, (camera.height - camera.cy) / camera.fy + margin_y)
    axes = rotation_matrices(gaussians.quaternions_wxyz) * gaussians.log_scales.exp()[:, None, :]
    t1 = (camera.fx / z)[:, None] * (rotation[0] - u[:, None] * rotation[2])
    t2 = (camera.fy / z)[:, None] * (rotation[1] - v[:, None] * rotation[2])
    m1 = (t1[:, None, :] @ axes)[:, 0]
    m2 = (t2[:, None, :] @ axes)[:, 0]

    xx, xy, yy = (m1 * m1).sum(-1), (m1 * m2).sum(-1), (m2 * m2).sum(-1)
    minors = torch.linalg.cross(m1, m2)
    determinant = (minors * minors).sum(-1) + BLUR_PX2 * (xx + yy) + BLUR_PX2**2
    xx, yy = xx + BLUR_PX2, yy + BLUR_PX2
    factors = torch.stack(
        [math.sqrt(0.5) * (yy / determinant).sqrt(), xy / yy, math.sqrt(0.5) / yy.sqrt()], dim=-1
    )

    opacities = torch.sigmoid(gaussians.opacity_logits)
    # Where alpha falls under its threshold: ½ dᵀ Σ⁻¹ d = ln(opacity / threshold).
    reach = (2 * (opacities / ALPHA_MIN).log().clamp_min(0)).sqrt()
    extents = reach[:, None] * torch.stack([xx, yy], dim=-1).sqrt()
    centers = torch.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], dim=-1)
    size = torch.tensor([camera.width, camera.height], dtype=means.dtype, device=means.device)
    on_screen = ((centers + extents > 0) & (centers - extents < size)).all(-1)
    visible = in_front & on_screen & (opacities >= ALPHA_MIN)

    camera_center = torch.as_tensor(
        camera_from_model.inverse().translation, dtype=means.dtype, device=means.device
    )
    directions = torch.nn.functional.normalize(means - camera_center, dim=-1)
    colors = sh_colors(gaussians.sh_dc, gaussians.sh_rest, directions, sh_degree)
    return ScreenSplats(centers, depths, factors, opacities, colors, extents.detach(), visible)
