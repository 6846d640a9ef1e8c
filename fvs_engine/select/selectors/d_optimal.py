"""D-optimality: the view that shrinks the volume of what the parameters may be the most."""

import torch
from torch import Tensor

from fvs_engine.score import MIN_COVERAGE
from fvs_engine.select.information_gain import InformationGain


def d_optimal() -> InformationGain:
    """Largest Σ ln(1 + H_candidate / (H_visited + λ)) first, with diagonal H (``InformationGain``).

    That is ln det(H_visited + λ + H_candidate) − ln det(H_visited + λ): unlike a trace, an entry that is
    hardly known cannot outweigh all others. Source: Wilson et al., "POp-GS: Next Best View in 3D-Gaussian
    Splatting with P-Optimality", CVPR 2025, diagonal. Cost: one gradient per candidate and visited view.

    Where most Gaussians are known well already, this all but counts those in view, and comes back to where
    they are dense: on *bonsai*, 20 views at random and 25,000 Gaussians, four fifths of the winner's gain
    comes from entries of which it says less than is known, and any λ from 1e-6 to 1 gives the same winner.
    """
    return InformationGain("d-optimal", log_determinant_gain, MIN_COVERAGE)


def log_determinant_gain(information: Tensor, known: Tensor) -> Tensor:
    """Σ ln(1 + H / K) over all entries, added up in float64."""
    return torch.log1p(information / known).sum(dtype=torch.float64)
