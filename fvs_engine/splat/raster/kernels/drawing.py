"""Blend splats front to back without a record of it, for renders that are not differentiated.

The blending is that of ``blending``. As no backward pass needs the lists of hits, less is listed, and what is
hidden costs next to nothing:

* tiles are four times as large, so that there are half as many hits, and a hit is only the number of a splat;
* which rows a splat touches is computed in its turn, and never for splats behind a finished tile; for a batch
  of splats at once, because a processor that had to wait for a row's number would guess it wrong;
* two rows of 8 pixels are blended at once: 16 lanes are one vector where vectors are that long.
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, inlined_kernel, kernel, parallel_kernel
from fvs_engine.splat.conventions import (
    BLUE,
    CENTER_X,
    CENTER_Y,
    DEPTH,
    EXTENT_X,
    EXTENT_Y,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    GREEN,
    HEIGHT,
    OPACITY,
    RED,
    SLOPE_X,
    SLOPE_Y,
)
from fvs_engine.splat.raster.kernels.binning import LANES, SLACK_PX, tile_box, tile_columns
from fvs_engine.splat.raster.kernels.blending import (
    LEAST_ALPHA,
    LEAST_T,
    MOST_ALPHA,
    SQRT_EIGHTH,
    exp_of_minus_eight,
)

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]
Longs = NDArray[np.int64]

SIDE_PX = 32
"""The side of a tile. It is kept in strips of 8 columns, these in pairs of rows."""
STRIPS, PAIRS = SIDE_PX // LANES, SIDE_PX // 2
PAIR = 2 * LANES
STRIP = PAIRS * PAIR
AREA = STRIPS * STRIP
BATCH = 32
"""Splats of a tile whose rows are listed, and that are blended, before a check which pairs are finished."""


@parallel_kernel
def deal(splats: Floats, tiles_x: int, tiles_y: int, parts: int) -> tuple[Longs, Ints]:
    """Deal depth-sorted splats to tiles in ``parts`` pieces of work; any number gives the same lists.

    Returns ``tile_starts`` [T + 1] into the list of ``hits`` [H]: in tile order, the numbers of the splats.
    """
    count, tiles = splats.shape[0], tiles_x * tiles_y
    counts = np.zeros((parts, tiles), np.int64)
    for part in numba.prange(parts):
        for i in range(part * count // parts, (part + 1) * count // parts):
            splat = splats[i]
            first_column, end_column, first_row, end_row = tile_box(splat, tiles_x, tiles_y, SIDE_PX)
            for row in range(first_row, end_row):
                first, end = tile_columns(splat, row, first_column, end_column, SIDE_PX)
                for column in range(first, end):
                    counts[part, row * tiles_x + column] += 1
    tile_starts = np.empty(tiles + 1, np.int64)
    total = 0
    for tile in range(tiles):
        tile_starts[tile] = total
        for part in range(parts):
            number = counts[part, tile]
            counts[part, tile] = total
            total += number
    tile_starts[tiles] = total

    hits = np.empty(total, np.int32)
    for part in numba.prange(parts):
        for i in range(part * count // parts, (part + 1) * count // parts):
            splat = splats[i]
            first_column, end_column, first_row, end_row = tile_box(splat, tiles_x, tiles_y, SIDE_PX)
            for row in range(first_row, end_row):
                first, end = tile_columns(splat, row, first_column, end_column, SIDE_PX)
                for column in range(first, end):
                    slot = counts[part, row * tiles_x + column]
                    counts[part, row * tiles_x + column] = slot + 1
                    hits[slot] = i
    return tile_starts, hits


@inlined_kernel
def _find_rows(splat: Floats, left: float, top: float, edges: Floats) -> None:
    """Where a splat's ellipse begins and ends in every strip of the tile at (``left``, ``top``).

    ``edges`` [8], in px from the top: rows from int(first four) to int(last four) − 1; none where both are 0.
    """
    extent, slope, half_height = splat[EXTENT_X], splat[SLOPE_Y], splat[HEIGHT]
    inverse, lowest = F(1) / extent, splat[SLOPE_X] * splat[EXTENT_Y]
    low_of_first = left + F(0.5) - splat[CENTER_X] - SLACK_PX
    middle = splat[CENTER_Y] + F(0.5) - top  # one more than in pixel rows, for int() to round up
    for edge in range(2 * STRIPS):
        side = F(1) if edge >= STRIPS else F(-1)
        low = low_of_first + F(edge % STRIPS * LANES)
        high = low + F(LANES - 1) + F(2) * SLACK_PX
        x = min(max(side * lowest, low), high)
        relative = x * inverse
        y = slope * x + side * (half_height * math.sqrt(max(F(1) - relative * relative, F(0))) + SLACK_PX)
        row = min(max(middle + y, F(0)), F(SIDE_PX))
        edges[edge] = row if (low <= extent) & (high >= -extent) else F(0)


@inlined_kernel
def _list_parts(splats: Floats, hits: Ints, left: float, top: float, parts: Ints) -> int:
    """List splat, strip and range of row pairs (first, last + 1) of all ``hits``; returns their number."""
    edges = np.empty(2 * STRIPS, np.float32)
    count = 0
    for n in hits:
        _find_rows(splats[n], left, top, edges)
        for strip in range(STRIPS):
            first = np.int32(edges[strip]) >> 1
            end = (np.int32(edges[strip + STRIPS]) + 1) >> 1
            part = parts[count]
            part[0], part[1], part[2], part[3] = n, strip, first, end
            count += int(first < end)
    return count


@kernel
def _blend_pair(
    buffer: Floats,
    at: np.uint64,
    start: tuple[float, float],
    step: tuple[float, float, float],
    splat: tuple[float, float, float, float, float],
) -> None:
    """Blend one splat into two rows of 8 pixels; its exponent is 8 (s² + q²).

    ``start``: s and q at the first pixel. ``step``: of s from pixel to pixel, of s and q from row to row.
    """
    s0, q0 = start
    along, s_down, q_down = step
    opacity, red, green, blue, depth = splat
    for lane in range(PAIR):
        i = at + np.uint64(lane)
        s = s0 + (along * F(lane % LANES) + s_down * F(lane // LANES))
        q = q0 + q_down * F(lane // LANES)
        alpha = min(opacity * exp_of_minus_eight(s * s + q * q), MOST_ALPHA)
        alpha = alpha if alpha >= LEAST_ALPHA else F(0)
        before = buffer[i]
        after = before - before * alpha
        live = after > LEAST_T
        weight = before * alpha if live else F(0)
        buffer[i] = after if live else -abs(before)
        buffer[i + np.uint64(AREA)] += weight * red
        buffer[i + np.uint64(2 * AREA)] += weight * green
        buffer[i + np.uint64(3 * AREA)] += weight * blue
        buffer[i + np.uint64(4 * AREA)] += weight * depth


@kernel
def _retire(buffer: Floats, live: Ints) -> bool:
    """Mark the pairs that still let light through; returns whether none does."""
    total = 0
    for pair in range(live.size):
        count = 0
        for lane in range(PAIR):
            count += buffer[np.uint64(pair * PAIR + lane)] > F(0)
        live[pair] = count
        total += count
    return total == 0


@parallel_kernel
def draw(
    splats: Floats,
    tile_starts: Longs,
    hits: Ints,
    color: Floats,
    alpha: Floats,
    depth: Floats,
) -> None:
    """Render ``color`` [H, W, 3], ``alpha`` [H, W] and ``depth`` [H, W] from splats that ``deal`` dealt."""
    height, width = alpha.shape
    tiles_x = (width + SIDE_PX - 1) // SIDE_PX
    for tile in numba.prange(tile_starts.size - 1):
        buffer = np.empty(5 * AREA, np.float32)
        buffer[:AREA] = F(1)
        buffer[AREA:] = F(0)
        live = np.ones(STRIPS * PAIRS, np.int32)
        parts = np.empty((BATCH * STRIPS, 4), np.int32)
        left, top = (tile % tiles_x) * SIDE_PX, (tile // tiles_x) * SIDE_PX
        end_slot = tile_starts[tile + 1]
        for slot in range(tile_starts[tile], end_slot, BATCH):
            count = _list_parts(splats, hits[slot : min(slot + BATCH, end_slot)], F(left), F(top), parts)
            for n, strip, first, end in parts[:count]:
                splat = splats[n]
                a, b = SQRT_EIGHTH * splat[FACTOR_A], SQRT_EIGHTH * splat[FACTOR_B]
                down = -a * splat[FACTOR_K]
                values = (splat[OPACITY], splat[RED], splat[GREEN], splat[BLUE], splat[DEPTH])
                dx = F(left + strip * LANES) + F(0.5) - splat[CENTER_X]
                dy = F(top) + F(0.5) - splat[CENTER_Y]
                s, q = a * dx + down * dy, b * dy
                for pair in range(first, end):
                    if live[strip * PAIRS + pair] == 0:
                        continue
                    y = F(2 * pair)
                    at = np.uint64(strip * STRIP + pair * PAIR)
                    _blend_pair(buffer, at, (s + down * y, q + b * y), (a, down, b), values)
            if _retire(buffer, live):
                break
        for strip in range(STRIPS):
            for y in range(min(SIDE_PX, height - top)):
                x0 = left + strip * LANES
                for x in range(x0, min(x0 + LANES, width)):
                    i = strip * STRIP + y * LANES + x - x0
                    transmittance = abs(buffer[i])
                    color[top + y, x, 0] = buffer[i + AREA]
                    color[top + y, x, 1] = buffer[i + 2 * AREA]
                    color[top + y, x, 2] = buffer[i + 3 * AREA]
                    alpha[top + y, x] = F(1) - transmittance
                    depth[top + y, x] = buffer[i + 4 * AREA]
