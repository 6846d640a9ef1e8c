"""Samples of points, targets and Gaussians, where all of them would take too long."""

import numpy as np
from numpy.typing import NDArray


def even_sample(count: int, most: int) -> NDArray[np.int64]:
    """Sorted indices of a uniform random sample, the same at every call: at most ``most`` of ``count``."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, max(1, most), replace=False))
