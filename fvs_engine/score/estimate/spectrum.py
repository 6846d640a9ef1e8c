"""The power of a view at a sample of frequencies."""

import numpy as np
from numpy.typing import NDArray

from fvs_engine.score.estimate.powers import SPACING, sum_powers

Floats = NDArray[np.float32]

_COUNT = round(0.5 / SPACING)
_X, _Y = np.meshgrid((np.arange(_COUNT) + 0.5) * SPACING, (np.arange(-_COUNT, _COUNT) + 0.5) * SPACING)
GRID = np.stack([_X.ravel(), _Y.ravel()], axis=1).astype(np.float32)
"""Frequencies [32, 2] in cycles/px: the middles of a grid over one half; the other half mirrors it."""

_ALIASES = np.arange(-2, 3)
_STEP_POWER = sum(
    ((GRID[:, 0] + u) ** 2 + (GRID[:, 1] + v) ** 2) ** -1.5 for u in _ALIASES for v in _ALIASES
) / (2 * np.pi**2)
"""The power of an edge, [32]: it falls by 1 / |f|³, and what is above the sampling frequency folds back."""

_JUMP_X, _JUMP_Y = 4.0 * np.sin(np.pi * GRID.astype(np.float64).T) ** 2
"""|1 − exp(−2πi f)|² [32]: a sequence that jumps once by 1 has the power 1 / jump."""


def expected_powers(
    splats: Floats, cells: Floats, side: float, seen: Floats, size: tuple[int, int]
) -> NDArray[np.float64]:
    """The expected |F|² [3, 32] at ``GRID``, of splats that ``cells.cover`` blended into ``cells``."""
    inside, across_x, across_y, steps = sum_powers(splats, cells, side, seen, size, GRID)
    corners = cells[1:, 0, 0] - cells[1:, 0, -1] - cells[1:, -1, 0] + cells[1:, -1, -1]
    borders = across_x / _JUMP_X + across_y / _JUMP_Y + corners[:, None] ** 2 / (_JUMP_X * _JUMP_Y)
    return np.asarray(inside + steps[:, None] * _STEP_POWER + borders, dtype=np.float64)
