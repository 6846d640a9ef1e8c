"""Textures in which feature detectors find plenty: dead leaves, at every scale and nowhere the same.

The *dead leaves* model (Matheron 1968; Lee, Mumford and Huang 2001) drops opaque discs of random size and
colour on one another. With radii distributed as r⁻³ its statistics are those of natural images: edges at
all scales, so that SIFT finds corners from near and from far.
"""

import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import kernel

_SMALLEST_TEXELS = 4.0
_LARGEST_SHARE = 0.12
_LARGEST_TEXELS = 80.0
_TEXELS_PER_LEAF = 50.0


def dead_leaves(
    height: int, width: int, tint: NDArray[np.float64], generator: np.random.Generator
) -> NDArray[np.uint8]:
    """A texture [height, width, 3], linear light; leaves scatter around the colour ``tint`` [3] in [0, 1]."""
    count = max(20, int(height * width / _TEXELS_PER_LEAF))
    largest = max(_SMALLEST_TEXELS + 1, min(_LARGEST_TEXELS, _LARGEST_SHARE * max(height, width)))
    # The inverse of the distribution function of a density ∝ r⁻³ between the two radii.
    u = generator.random(count)
    inverse_squares = _SMALLEST_TEXELS**-2 + u * (largest**-2 - _SMALLEST_TEXELS**-2)
    radii = 1.0 / np.sqrt(inverse_squares)
    centres = generator.random((count, 2)) * [height, width]
    brightness = generator.uniform(0.15, 1.6, (count, 1))
    colors = np.clip(brightness * tint + generator.normal(scale=0.10, size=(count, 3)), 0.01, 1.0)
    texture = np.empty((height, width, 3), dtype=np.uint8)
    texture[:] = np.round(255 * tint).astype(np.uint8)
    _drop(texture, centres, radii, np.round(255 * colors).astype(np.uint8))
    return texture


@kernel
def _drop(
    texture: NDArray[np.uint8],
    centres: NDArray[np.float64],
    radii: NDArray[np.float64],
    colors: NDArray[np.uint8],
) -> None:
    """Paint the leaves one after the other, later ones over earlier ones."""
    height, width, _ = texture.shape
    for leaf in range(len(radii)):
        y, x = centres[leaf]
        radius = radii[leaf]
        for row in range(max(0, int(y - radius)), min(height, int(y + radius) + 1)):
            for column in range(max(0, int(x - radius)), min(width, int(x + radius) + 1)):
                dy, dx = row + 0.5 - y, column + 0.5 - x
                if dx * dx + dy * dy <= radius * radius:
                    texture[row, column, 0] = colors[leaf, 0]
                    texture[row, column, 1] = colors[leaf, 1]
                    texture[row, column, 2] = colors[leaf, 2]
