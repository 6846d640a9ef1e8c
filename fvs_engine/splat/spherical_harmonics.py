"""Real spherical harmonics up to degree 3, as colours of a direction.

The constants are those of the real orthonormal basis with the Condon-Shortley signs that 3DGS files use.
Source: Sloan, "Efficient Spherical Harmonic Evaluation", 2013.
"""

import torch
from torch import Tensor

SH_C0 = 0.28209479177387814
"""The constant harmonic, 1 / (2 √π)."""
SH_C1 = 0.4886025119029199
SH_C2 = (1.0925484305920792, 0.31539156525252005, 0.5462742152960396)
SH_C3 = (0.5900435899266435, 2.890611442640554, 0.4570457994644658, 0.3731763325901154, 1.445305721320277)


def sh_basis(directions: Tensor, degree: int) -> Tensor:
    """Values [N, (degree + 1)²] of the basis functions in unit directions [N, 3]."""
    x, y, z = directions.unbind(-1)
    values = [torch.full_like(x, SH_C0)]
    if degree >= 1:
        values += [-SH_C1 * y, SH_C1 * z, -SH_C1 * x]
    if degree >= 2:
        a, b, c = SH_C2
        values += [a * x * y, -a * y * z, b * (2 * z * z - x * x - y * y), -a * x * z, c * (x * x - y * y)]
    if degree >= 3:
        a, b, c, d, e = SH_C3
        values += [
            -a * y * (3 * x * x - y * y),
            b * x * y * z,
            -c * y * (4 * z * z - x * x - y * y),
            d * z * (2 * z * z - 3 * x * x - 3 * y * y),
            -c * x * (4 * z * z - x * x - y * y),
            e * z * (x * x - y * y),
            -a * x * (x * x - 3 * y * y),
        ]
    return torch.stack(values, dim=-1)


def sh_colors(sh_dc: Tensor, sh_rest: Tensor, directions: Tensor, degree: int) -> Tensor:
    """Colours [N, 3] ≥ 0 seen along unit ``directions`` [N, 3], using ``degree`` degrees.

    ``sh_dc`` [N, 3], ``sh_rest`` [N, K − 1, 3]; only the first (degree + 1)² coefficients are read.
    """
    basis = sh_basis(directions, degree)
    colors = 0.5 + SH_C0 * sh_dc
    if degree > 0:
        colors = colors + (basis[:, 1:, None] * sh_rest[:, : basis.shape[1] - 1]).sum(1)
    return colors.clamp_min(0)


def dc_from_color(colors: Tensor) -> Tensor:
    """The degree-0 coefficients [N, 3] that show ``colors`` [N, 3] in [0, 1] from everywhere."""
    return (colors - 0.5) / SH_C0
