"""Which images look alike: one vector per image from its local descriptors (VLAD).

Source: Jégou et al., "Aggregating local descriptors into a compact image representation", CVPR 2010; with the
square-root normalisation of Arandjelović & Zisserman, "All about VLAD", CVPR 2013. The vocabulary is learnt
from the images themselves, so that nothing has to be downloaded.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2, vq

_WORDS = 64
_SAMPLE = 20_000
"""Descriptors that the vocabulary is learnt from."""

_PER_IMAGE = 1_000
"""Descriptors that describe an image; the database lists the largest features first."""


def global_descriptors(
    read: Callable[[int], NDArray[np.float32]], count: int, seed: int, on_image: Callable[[int], None]
) -> NDArray[np.float32]:
    """Unit vectors [count, 64 · 128]; ``read(i)`` gives image i's descriptors [K, 128]. Zero where K = 0."""
    generator = np.random.default_rng(seed)
    local = [_normalised(read(i)[:_PER_IMAGE]) for i in range(count)]
    pool = np.concatenate(local)
    if len(pool) < _WORDS:
        return np.zeros((count, 1), dtype=np.float32)
    sample = pool[generator.choice(len(pool), size=min(_SAMPLE, len(pool)), replace=False)]
    words, _ = kmeans2(sample, _WORDS, iter=10, minit="points", seed=generator, missing="warn")
    vectors = np.zeros((count, _WORDS, 128), dtype=np.float32)
    for i, descriptors in enumerate(local):
        if len(descriptors) > 0:
            nearest, _ = vq(descriptors, words)
            np.add.at(vectors[i], nearest, descriptors - words[nearest])
        on_image(i + 1)
    vectors = np.sign(vectors) * np.sqrt(np.abs(vectors))
    flat = vectors.reshape(count, -1)
    return np.asarray(flat / np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-12), dtype=np.float32)


def _normalised(descriptors: NDArray[np.float32]) -> NDArray[np.float32]:
    norms = np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1e-12)
    return np.asarray(descriptors / norms, dtype=np.float32)
