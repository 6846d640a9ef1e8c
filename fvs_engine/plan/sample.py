"""A sample of many things, where all of them would take too long."""

import numpy as np
from numpy.typing import NDArray


def even_sample(count: int, most: int) -> NDArray[np.int64]:
    """Ascending indices of at most ``most`` (at least one) of ``count``, drawn evenly and always the same."""
    if count <= most:
        return np.arange(count)
    return np.sort(np.random.default_rng(0).choice(count, max(1, most), replace=False))
