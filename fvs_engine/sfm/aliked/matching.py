"""Matches between the descriptors of two photographs; without torch, which takes seconds to import."""

import numpy as np
from numpy.typing import NDArray

_RATIO = 0.90
"""Maximum ratio of the distances to the nearest and the second nearest descriptor."""


def match(first: NDArray[np.float32], second: NDArray[np.float32]) -> NDArray[np.uint32]:
    """Indices [M, 2] of mutual nearest neighbours among unit descriptors [K, D] that pass the ratio test."""
    if min(len(first), len(second)) < 2:
        return np.zeros((0, 2), dtype=np.uint32)
    cosines = first @ second.T
    forward, backward = _nearest(cosines), _nearest(cosines.T)
    numbers = np.arange(len(first))
    mutual = (forward >= 0) & (backward[forward] == numbers)
    return np.stack((numbers[mutual], forward[mutual]), axis=1).astype(np.uint32)


def _nearest(cosines: NDArray[np.float32]) -> NDArray[np.int64]:
    """The column with the largest cosine in each row; -1 where the ratio test fails."""
    rows, columns = np.arange(len(cosines)), cosines.argmax(axis=1)
    others = cosines.copy()
    others[rows, columns] = -1.0
    nearest, next_ = (
        np.maximum(2.0 - 2.0 * values, 0.0) for values in (cosines[rows, columns], others.max(axis=1))
    )
    return np.where(nearest < _RATIO**2 * next_, columns, -1)  # squared distances
