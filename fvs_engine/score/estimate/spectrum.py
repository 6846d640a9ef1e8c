"""The power of a view at a sample of frequencies."""

import numpy as np
from numpy.typing import NDArray

from fvs_engine.score.estimate import kernels
from fvs_engine.score.estimate.kernels import Floats, Longs

_COUNT = 4
_STEP = 0.5 / _COUNT
_X, _Y = np.meshgrid((np.arange(_COUNT) + 0.5) * _STEP, (np.arange(-_COUNT, _COUNT) + 0.5) * _STEP)
GRID = np.stack([_X.ravel(), _Y.ravel()], axis=1).astype(np.float32)
"""Frequencies [32, 2] in cycles/px: the middles of a grid over one half; the other half mirrors it."""

_ALIASES = np.arange(-2, 3)
_STEP_POWER = sum(
    ((GRID[:, 0] + u) ** 2 + (GRID[:, 1] + v) ** 2) ** -1.5 for u in _ALIASES for v in _ALIASES
) / (2 * np.pi**2)
"""The power of an edge, [32]: it falls by 1 / |f|³, and what is above the sampling frequency folds back."""

_JUMP_X, _JUMP_Y = 4.0 * np.sin(np.pi * GRID.astype(np.float64).T) ** 2
"""|1 − exp(−2πi f)|² [32]: a sequence that jumps once by 1 has the power 1 / jump."""


def powers(
    records: Floats, order: Longs, cells: Floats, seen: Floats, size: tuple[int, int]
) -> NDArray[np.float64]:
    """The expected |F|² [3, 32] at ``GRID``, of splats that ``kernels.project`` and ``cover`` left."""
    inside, across_x, across_y = (np.zeros((3, len(GRID)), np.float32) for _ in range(3))
    steps = np.zeros(3, np.float32)
    kernels.sum_powers(records, order, cells, seen, size, GRID, inside, across_x, across_y, steps)
    corners = cells[0, 0, :3] - cells[0, -1, :3] - cells[-1, 0, :3] + cells[-1, -1, :3]
    borders = across_x / _JUMP_X + across_y / _JUMP_Y + corners[:, None] ** 2 / (_JUMP_X * _JUMP_Y)
    return np.asarray(inside + steps[:, None] * _STEP_POWER + borders, dtype=np.float64)
