"""Gaussians in another frame: a similarity applied to positions, orientations, sizes and harmonics."""

import numpy as np
import torch
from torch import Tensor

from fvs_engine.geometry import SimilarityTransform, quaternion_from_matrix
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.spherical_harmonics import sh_basis

_DIRECTIONS = 64
"""Directions in which harmonics are compared: four times the 16 functions of degree 3."""


def moved(gaussians: Gaussians, target_from_source: SimilarityTransform) -> Gaussians:
    """The same Gaussians in the target frame, where a moved camera sees the same picture.

    Computed in float64 and rounded once, to float32.
    """
    rotation = torch.from_numpy(target_from_source.rotation)
    offset = torch.from_numpy(target_from_source.translation)
    scale = target_from_source.scale
    turn = torch.from_numpy(quaternion_from_matrix(target_from_source.rotation))
    means = scale * gaussians.means.detach().cpu().double() @ rotation.T + offset
    return Gaussians(
        means=means.float(),
        log_scales=(gaussians.log_scales.detach().cpu().double() + np.log(scale)).float(),
        quaternions_wxyz=_product(turn, gaussians.quaternions_wxyz.detach().cpu().double()).float(),
        opacity_logits=gaussians.opacity_logits.detach().cpu(),
        sh_dc=gaussians.sh_dc.detach().cpu(),
        sh_rest=_turned(gaussians.sh_rest.detach().cpu(), rotation, gaussians.sh_degree),
    )


def _product(first: Tensor, second: Tensor) -> Tensor:
    """The quaternions of the turns ``second`` [N, 4] followed by ``first`` [4]."""
    w, vector = first[0], first[1:]
    others, vectors = second[:, :1], second[:, 1:]
    real = w * others - (vectors @ vector)[:, None]
    crossed = torch.linalg.cross(vector.expand_as(vectors), vectors)
    return torch.cat([real, w * vectors + others * vector + crossed], dim=1)


def _turned(sh_rest: Tensor, rotation: Tensor, degree: int) -> Tensor:
    """Coefficients [N, K - 1, 3] that show in the turned direction what was seen in each direction.

    Functions of one degree become functions of the same degree, so each degree has a matrix of its own. It
    is solved for in more directions than there are functions, which determine it exactly.
    """
    draw = torch.Generator().manual_seed(0)
    directions = torch.nn.functional.normalize(torch.randn(_DIRECTIONS, 3, generator=draw).double(), dim=1)
    before, after = sh_basis(directions, degree), sh_basis(directions @ rotation.T, degree)
    turned = sh_rest.clone()
    for order in range(1, degree + 1):
        functions = slice(order**2, (order + 1) ** 2)
        matrix = torch.linalg.lstsq(after[:, functions], before[:, functions]).solution
        rest = slice(order**2 - 1, (order + 1) ** 2 - 1)
        turned[:, rest] = torch.einsum("ij,njc->nic", matrix, sh_rest[:, rest].double()).float()
    return turned
