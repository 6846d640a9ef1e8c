"""Initial Gaussians: one on every sparse point."""

import numpy as np
import torch
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import logit

from fvs_engine.errors import TrainingError
from fvs_engine.splat.gaussians import Gaussians
from fvs_engine.splat.settings import sh_coefficient_count
from fvs_engine.splat.spherical_harmonics import dc_from_color

INITIAL_OPACITY = 0.1
NEIGHBORS = 3
SMALLEST_SPACING = 0.01
LARGEST_SPACING = 30.0
"""Bounds on a Gaussian's size, in median spacings: sparse points contain near-duplicates and far outliers."""


def initialise_from_points(
    points: NDArray[np.float64],
    colors: NDArray[np.uint8],
    sh_degree: int,
    spacing: NDArray[np.float64] | None = None,
) -> Gaussians:
    """Place a round Gaussian on each point, as large as the mean distance to its three neighbours.

    ``points`` [P, 3] in the model frame; ``colors`` [P, 3] uint8. Points that are not finite are left out.
    ``spacing`` [P] replaces the distances to neighbours, for points whose neighbours are not among them.
    Raises ``TrainingError`` when no point remains. Source: Kerbl et al., 2023, section 5.
    """
    finite = np.isfinite(points).all(axis=1)
    points, colors = np.asarray(points, np.float64)[finite], colors[finite]
    count = len(points)
    if count == 0:
        raise TrainingError(
            "There is no sparse point to start from.", hint="Give more photographs that overlap."
        )
    sizes = point_spacing(points) if spacing is None else spacing[finite]
    quaternions = torch.zeros(count, 4)
    quaternions[:, 0] = 1.0
    return Gaussians(
        means=torch.from_numpy(points.astype(np.float32)),
        log_scales=torch.from_numpy(np.log(sizes).astype(np.float32))[:, None].repeat(1, 3),
        quaternions_wxyz=quaternions,
        opacity_logits=torch.full((count,), float(logit(INITIAL_OPACITY))),
        sh_dc=dc_from_color(torch.from_numpy(colors / 255)).float(),
        sh_rest=torch.zeros(count, sh_coefficient_count(sh_degree) - 1, 3),
    )


def point_spacing(points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Mean distance of each of the points [P, 3] to its three nearest others, within sane bounds [P].

    Coinciding points share the distance to the nearest *other* positions. If there is no other position, the
    spacing is a hundredth of the distance to the origin.
    """
    places, place_of_point = np.unique(points, axis=0, return_inverse=True)
    place_of_point = place_of_point.reshape(-1)
    neighbors = min(NEIGHBORS, len(places) - 1)
    if neighbors <= 0:
        alone = 0.01 * max(float(np.linalg.norm(points[:1])), 1e-3)
        return np.full(len(points), alone)
    distances, _ = cKDTree(places).query(places, k=neighbors + 1)
    spacing = distances[:, 1:].mean(axis=1)
    typical = np.median(spacing)
    bounded = np.clip(spacing, SMALLEST_SPACING * typical, LARGEST_SPACING * typical)
    return np.asarray(bounded[place_of_point])
