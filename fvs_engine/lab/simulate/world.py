"""The world that is photographed: textured rectangles, opaque from both sides, under an even sky."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fvs_engine.errors import InvalidInputError
from fvs_engine.lab.simulate.textures import dead_leaves

Array = NDArray[np.float64]

GROUND_TEXEL_M, BOX_TEXEL_M = 0.008, 0.004
"""Side of a texel: finer than a pixel of a usual camera from where each is seen."""
SETTLEMENT_TEXEL_M = 0.04
"""The same for what is seen from 30 m above."""
_HALF_WIDTH_M = 4.0
"""Half of a courtyard's side."""
_LENGTH_M, _WIDTH_M = 180.0, 120.0
"""Extent of a settlement."""


@dataclass(frozen=True, eq=False)
class Rectangle:
    """A parallelogram with right angles: ``corner`` [3] and two sides [3], in metres.

    ``texture`` [rows, columns, 3] uint8, linear light: columns along ``side_u``, rows along ``side_v``.
    Raises ``InvalidInputError`` for sides that are zero or not at right angles.
    """

    corner: Array
    side_u: Array
    side_v: Array
    texture: NDArray[np.uint8]

    def __post_init__(self) -> None:
        lengths = np.linalg.norm([self.side_u, self.side_v], axis=1)
        if not (lengths > 0).all() or abs(self.side_u @ self.side_v) > 1e-9 * lengths.prod():
            raise InvalidInputError("A rectangle needs two sides at right angles.")


@dataclass(frozen=True, eq=False)
class World:
    """Rectangles, and the sky [3] in linear light of [0, 1]. Axes: x and y level, z up; metres."""

    rectangles: tuple[Rectangle, ...]
    sky: tuple[float, float, float] = (0.55, 0.65, 0.80)


def courtyard(seed: int = 0, boxes: int = 9) -> World:
    """A walled yard around the origin with boxes in it that hide one another and the walls.

    The ground is z = 0; the walls are 2.5 m high; boxes are within 1.8 m of the centre, so that a
    vehicle can circle them at 2.5 to 3.5 m.
    """
    generator = np.random.default_rng(seed)
    w = _HALF_WIDTH_M
    rectangles = [textured([-w, -w, 0], [2 * w, 0, 0], [0, 2 * w, 0], GROUND_TEXEL_M, generator)]
    corners = np.array([[-w, -w, 0], [w, -w, 0], [w, w, 0], [-w, w, 0]])
    for corner, after in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        rectangles.append(textured(corner, after - corner, [0, 0, 2.5], GROUND_TEXEL_M, generator))
    for _ in range(boxes):
        angle, distance = generator.uniform(0, 2 * np.pi), 1.8 * np.sqrt(generator.random())
        centre = distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        size = np.array([*generator.uniform(0.25, 0.8, 2), generator.uniform(0.3, 1.6)])
        rectangles += box(centre, size, generator.uniform(0, np.pi), generator)
    return World(tuple(rectangles))


def settlement(seed: int = 0, houses: int = 90) -> World:
    """Boxes as large as houses, 3 to 9 m high, on level ground around the origin, as a survey sees them."""
    generator = np.random.default_rng(seed)
    half = 0.5 * np.array([_LENGTH_M, _WIDTH_M, 0.0])
    sides = ([_LENGTH_M, 0, 0], [0, _WIDTH_M, 0])
    rectangles = [textured(-half, *sides, SETTLEMENT_TEXEL_M, generator)]
    for _ in range(houses):
        foot = generator.uniform(-half, half)
        size = np.array([*generator.uniform(5.0, 14.0, 2), generator.uniform(3.0, 9.0)])
        rectangles += box(foot, size, generator.uniform(0, np.pi), generator, SETTLEMENT_TEXEL_M)
    return World(tuple(rectangles))


def box(
    foot: Array, size: Array, turn: float, generator: np.random.Generator, texel_m: float = BOX_TEXEL_M
) -> list[Rectangle]:
    """Four sides and a lid of a box on the ground, ``foot`` [3] the middle of its base."""
    c, s = np.cos(turn), np.sin(turn)
    x, y = size[0] * np.array([c, s, 0.0]), size[1] * np.array([-s, c, 0.0])
    z = np.array([0.0, 0.0, size[2]])
    corner = foot - 0.5 * (x + y)
    faces: Sequence[tuple[Array, Array, Array]] = (
        (corner, x, z),
        (corner + y, x, z),
        (corner, y, z),
        (corner + x, y, z),
        (corner + z, x, y),
    )
    return [textured(*face, texel_m, generator) for face in faces]


def textured(
    corner: ArrayLike, side_u: ArrayLike, side_v: ArrayLike, texel_m: float, generator: np.random.Generator
) -> Rectangle:
    """A rectangle with a texture of its own, of texels of ``texel_m``."""
    u, v = np.asarray(side_u, dtype=np.float64), np.asarray(side_v, dtype=np.float64)
    columns, rows = (max(8, round(float(np.linalg.norm(side)) / texel_m)) for side in (u, v))
    tint = generator.uniform(0.15, 0.6, 3)
    return Rectangle(np.asarray(corner, np.float64), u, v, dead_leaves(rows, columns, tint, generator))
