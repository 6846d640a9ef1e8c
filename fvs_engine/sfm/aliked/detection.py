"""Differentiable keypoint detection: peaks of the score map, with subpixel accuracy.

Source: Zhao et al., "ALIKE: Accurate and Lightweight Keypoint Detection and Descriptor Extraction", IEEE
Transactions on Multimedia 2022, section III-B.
"""

import torch
from torch import Tensor
from torch.nn import functional

RADIUS = 2
"""Radius of non-maximum suppression in px."""

_TEMPERATURE = 0.1
"""Temperature of the soft maximum around a peak."""

_ROUNDS = 2
"""Further passes of non-maximum suppression, which find peaks near suppressed ones."""


def detect(scores: Tensor, least: float, most: int) -> Tensor:
    """Positions [K, 2] (x, y in px, the first pixel's centre at (0, 0)) of the peaks of ``scores`` [H, W].

    Only peaks above ``least``, at most ``most`` of them, the highest first.
    """
    height, width = scores.shape
    peaks = torch.where(_peaks(scores), scores, 0.0)
    inside = torch.zeros_like(scores)
    inside[RADIUS : height - RADIUS, RADIUS : width - RADIUS] = 1.0
    heights = (peaks * inside).flatten()
    found = torch.nonzero(heights > least)[:, 0]
    order = torch.argsort(heights[found], descending=True, stable=True)[:most]
    found = found[order]
    x, y = found % width, torch.div(found, width, rounding_mode="floor")
    return torch.stack((x, y), dim=1) + _refinement(scores, x, y)


def _peaks(scores: Tensor) -> Tensor:
    """Mask [H, W] of the local maxima, also of those that remain when pixels near peaks are suppressed."""
    peaks = scores == _highest(scores)
    for _ in range(_ROUNDS):
        near = _highest(peaks.to(scores.dtype)) > 0
        rest = scores.masked_fill(near, 0.0)
        peaks |= (rest == _highest(rest)) & ~near
    return peaks


def _highest(values: Tensor) -> Tensor:
    """The maximum [H, W] within ``RADIUS`` of each pixel."""
    side = 2 * RADIUS + 1
    return functional.max_pool2d(values[None, None], side, stride=1, padding=RADIUS)[0, 0]


def _refinement(scores: Tensor, x: Tensor, y: Tensor) -> Tensor:
    """The offsets [K, 2] of the soft maxima around the peaks at pixels ``x``, ``y`` [K]."""
    steps = torch.arange(-RADIUS, RADIUS + 1, device=scores.device)
    dy, dx = (grid.flatten() for grid in torch.meshgrid(steps, steps, indexing="ij"))
    around = scores[y[:, None] + dy, x[:, None] + dx]
    weights = torch.softmax(around / _TEMPERATURE, dim=1)
    return weights @ torch.stack((dx, dy), dim=1).to(scores.dtype)
