"""Courtyards whose walls look alike, in which structure from motion mistakes one place for another."""

import numpy as np
from numpy.typing import NDArray

from fvs_engine.choices import LookAlike
from fvs_engine.lab.simulate.textures import dead_leaves
from fvs_engine.lab.simulate.world import GROUND_TEXEL_M, Rectangle, World, box, textured

_WALL_HEIGHT_M = 2.5
_WINDOW_M = (0.9, 1.1)
"""Width and height of a window."""
_SILL_M = 0.8
_BETWEEN_WINDOWS_M = 1.6
_PLASTER_CONTRAST = 0.25
"""Contrast of the plaster between windows, which differs, as a share of other textures'."""


def lookalike_courtyard(alike: LookAlike, seed: int = 0, half_width_m: float = 4.0, boxes: int = 3) -> World:
    """A walled yard around the origin, whose walls look alike and whose ground and ``boxes`` do not.

    ``four``: all walls have one façade, so that a quarter turn changes nothing but what is in the yard;
    ``two``: those at −y and +y have; ``windows``: every wall is plaster of its own with a row of one window,
    the same everywhere. The ground is z = 0; the walls are 2.5 m high; boxes are within 0.8 m of the centre.
    """
    generator = np.random.default_rng(seed)
    w = half_width_m
    rectangles = [textured([-w, -w, 0], [2 * w, 0, 0], [0, 2 * w, 0], GROUND_TEXEL_M, generator)]
    facades = _facades(alike, 2 * w, generator)
    corners = np.array([[-w, -w, 0], [w, -w, 0], [w, w, 0], [-w, w, 0]])
    for corner, after, facade in zip(corners, np.roll(corners, -1, axis=0), facades, strict=True):
        rectangles.append(Rectangle(corner, after - corner, np.array([0, 0, _WALL_HEIGHT_M]), facade))
    for _ in range(boxes):
        angle, distance = generator.uniform(0, 2 * np.pi), 0.8 * np.sqrt(generator.random())
        foot = distance * np.array([np.cos(angle), np.sin(angle), 0.0])
        size = np.array([*generator.uniform(0.2, 0.5, 2), generator.uniform(0.3, 0.9)])
        rectangles += box(foot, size, generator.uniform(0, np.pi), generator)
    return World(tuple(rectangles))


def _facades(
    alike: LookAlike, length_m: float, generator: np.random.Generator
) -> tuple[NDArray[np.uint8], ...]:
    """The textures of the walls at −y, +x, +y and −x; columns run to the right for who looks from outside."""
    columns, rows = round(length_m / GROUND_TEXEL_M), round(_WALL_HEIGHT_M / GROUND_TEXEL_M)

    def leaves() -> NDArray[np.uint8]:
        return dead_leaves(rows, columns, generator.uniform(0.15, 0.6, 3), generator)

    if alike == "four":
        return (leaves(),) * 4
    if alike == "two":
        twin = leaves()
        return twin, leaves(), twin, leaves()
    width, height = (round(side / GROUND_TEXEL_M) for side in _WINDOW_M)
    window = dead_leaves(height, width, generator.uniform(0.15, 0.6, 3), generator)
    return tuple(_with_windows(leaves(), window) for _ in range(4))


def _with_windows(leaves: NDArray[np.uint8], window: NDArray[np.uint8]) -> NDArray[np.uint8]:
    mean = leaves.mean(axis=(0, 1))
    facade: NDArray[np.uint8] = np.round(mean + _PLASTER_CONTRAST * (leaves - mean)).astype(np.uint8)
    height, width, _ = window.shape
    sill, step = round(_SILL_M / GROUND_TEXEL_M), round(_BETWEEN_WINDOWS_M / GROUND_TEXEL_M)
    for left in range((step - width) // 2, facade.shape[1] - width, step):
        facade[sill : sill + height, left : left + width] = window
    return facade
