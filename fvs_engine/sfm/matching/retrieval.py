"""Image retrieval: one global descriptor per image, aggregated from its local ones (VLAD).

Source: Jégou et al., "Aggregating local descriptors into a compact image representation", CVPR 2010; with the
square-root normalisation of Arandjelović & Zisserman, "All about VLAD", CVPR 2013. The vocabulary is computed
from the images themselves, so that nothing has to be downloaded.
"""

import warnings
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2, vq

_WORDS = 64
_SAMPLE = 20_000
"""Number of local descriptors that the vocabulary is computed from."""

_PER_IMAGE = 1_000
"""Number of local descriptors per image; the database lists the largest features first."""


def global_descriptors(
    read: Callable[[int], NDArray[np.float32]], count: int, seed: int, on_image: Callable[[int], None]
) -> NDArray[np.float32]:
    """Unit vectors [count, 64 · 128]; ``read(i)`` gives image i's descriptors [K, 128]. Zero where K = 0."""
    local = [read(i)[:_PER_IMAGE] for i in range(count)]
    words = compute_vocabulary(local, seed)
    if words is None:
        return np.zeros((count, 1), dtype=np.float32)
    vectors = []
    for i, descriptors in enumerate(local):
        vectors.append(describe(words, descriptors))
        on_image(i + 1)
    return np.stack(vectors)


def compute_vocabulary(local: Sequence[NDArray[np.float32]], seed: int) -> NDArray[np.float32] | None:
    """The vocabulary [64, 128] of some images' descriptors [K, 128] each; None if they are too few."""
    generator = np.random.default_rng(seed)
    pool = np.concatenate([_normalised(descriptors[:_PER_IMAGE]) for descriptors in local])
    if len(pool) < _WORDS:
        return None
    sample = pool[generator.choice(len(pool), size=min(_SAMPLE, len(pool)), replace=False)]
    with warnings.catch_warnings():
        # An empty cluster keeps its initial word, which is harmless.
        warnings.filterwarnings("ignore", message="One of the clusters is empty")
        words, _ = kmeans2(sample, _WORDS, iter=10, minit="points", seed=generator, missing="warn")
    return np.asarray(words, dtype=np.float32)


def describe(words: NDArray[np.float32], descriptors: NDArray[np.float32]) -> NDArray[np.float32]:
    """The unit vector [64 · 128] of an image with ``descriptors`` [K, 128]; zero where K = 0."""
    vector = np.zeros((_WORDS, 128), dtype=np.float32)
    if len(descriptors) > 0:
        local = _normalised(descriptors[:_PER_IMAGE])
        nearest, _ = vq(local, words)
        np.add.at(vector, nearest, local - words[nearest])
    flat = (np.sign(vector) * np.sqrt(np.abs(vector))).ravel()
    return np.asarray(flat / max(float(np.linalg.norm(flat)), 1e-12), dtype=np.float32)


def _normalised(descriptors: NDArray[np.float32]) -> NDArray[np.float32]:
    norms = np.maximum(np.linalg.norm(descriptors, axis=1, keepdims=True), 1e-12)
    return np.asarray(descriptors / norms, dtype=np.float32)
