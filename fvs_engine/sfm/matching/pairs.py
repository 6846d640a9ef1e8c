"""Selection of the pairs of images to match."""

from collections.abc import Iterable, Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Pair = tuple[int, int]

_IN_ORDER = 8
"""Number of next images that each one is matched with, followed by images at distances 2^k."""

_IN_SPACE = 12
"""Number of nearest images by position prior that each one is matched with."""

_BY_SIMILARITY = 12
"""Number of most similar images that each one is matched with."""


def exhaustive_pairs(count: int) -> list[Pair]:
    """All pairs of ``count`` images, as indices, the smaller first."""
    return [(i, j) for i in range(count) for j in range(i + 1, count)]


def selected_pairs(
    count: int, descriptors: NDArray[np.float32], positions: Mapping[int, NDArray[np.float64]]
) -> list[Pair]:
    """Pairs that are near in capture order or in space, or similar: linear in the number of images.

    ``descriptors`` [count, D] are unit global descriptors (``retrieval``), ``positions`` maps the indices
    with a position prior to [3]. Every criterion adds pairs, so a misleading one (shuffled names, bad
    positions) costs only time.
    """
    pairs = set(_in_order(count)) | set(_by_similarity(descriptors))
    if positions:
        pairs |= set(_in_space(positions))
    return sorted(pairs)


def _in_order(count: int) -> list[Pair]:
    steps = list(range(1, _IN_ORDER + 1))
    step = 2 * _IN_ORDER
    while step < count and len(steps) < 2 * _IN_ORDER:
        steps.append(step)
        step *= 2
    return [(i, i + step) for i in range(count) for step in steps if i + step < count]


def _by_similarity(descriptors: NDArray[np.float32]) -> list[Pair]:
    similarity = descriptors @ descriptors.T
    np.fill_diagonal(similarity, -np.inf)
    nearest = np.argsort(-similarity, axis=1, kind="stable")[:, :_BY_SIMILARITY]
    return _sorted_pairs((i, int(j)) for i, row in enumerate(nearest) for j in row if j != i)


def _in_space(positions: Mapping[int, NDArray[np.float64]]) -> list[Pair]:
    indices = list(positions)
    tree = cKDTree(np.stack([positions[i] for i in indices]))
    neighbours = min(_IN_SPACE + 1, len(indices))
    _, nearest = tree.query(tree.data, k=[*range(1, neighbours + 1)])
    return _sorted_pairs(
        (indices[i], indices[int(j)]) for i, row in enumerate(nearest) for j in row if int(j) != i
    )


def _sorted_pairs(pairs: Iterable[Pair]) -> list[Pair]:
    return [(min(pair), max(pair)) for pair in pairs]
