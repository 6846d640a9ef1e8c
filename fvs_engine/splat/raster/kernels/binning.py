"""Which splats touch which tiles, front to back.

Splats are sorted by depth once; a counting sort then deals them to tiles, so every tile's list comes out
ordered. A *hit* is one splat in one tile. Hits are numbered in splat order (all hits of a splat are
neighbours, so its gradient is one contiguous sum) and listed in tile order. A splat is listed only in
tiles that its ellipse, not merely its box, touches.
"""

import math

import numba
import numpy as np
from numpy.typing import NDArray

from fvs_engine.compilation.kernels import F, inlined_kernel, kernel, parallel_kernel
from fvs_engine.splat.conventions import (
    CENTER_X,
    CENTER_Y,
    DEPTH,
    EXTENT_X,
    EXTENT_Y,
    HEIGHT,
    RECORD_SIZE,
    SLOPE_X,
    SLOPE_Y,
    WIDTH,
)

Floats = NDArray[np.float32]
Ints = NDArray[np.int32]

TILE_PX = 16
LANES = 8  # pixels of a row that are blended at once
HALVES = TILE_PX // LANES
SLACK_PX = F(0.02)  # rounding must not drop a pixel whose alpha is just at its threshold


@kernel
def front_to_back(records: Floats, radii: Floats) -> NDArray[np.int64]:
    """Indices [V] of the visible splats by depth, ties by index: a radix sort of the depths' bits."""
    count = 0
    for n in range(radii.size):
        count += radii[n] > F(0)
    order = np.empty(count, np.int64)
    keys = np.empty(count, np.float32)
    at = 0
    for n in range(radii.size):
        if radii[n] > F(0):
            order[at] = n
            keys[at] = records[n, DEPTH]  # positive, so their bits sort as they do
            at += 1
    bits = keys.view(np.uint32)
    other_bits, other_order = np.empty_like(bits), np.empty_like(order)
    for shift in (np.uint32(0), np.uint32(11), np.uint32(22)):
        starts = np.zeros(2049, np.int64)
        for i in range(count):
            starts[((bits[i] >> shift) & np.uint32(2047)) + 1] += 1
        for digit in range(2048):
            starts[digit + 1] += starts[digit]
        for i in range(count):
            digit = (bits[i] >> shift) & np.uint32(2047)
            other_bits[starts[digit]] = bits[i]
            other_order[starts[digit]] = order[i]
            starts[digit] += 1
        bits, other_bits = other_bits, bits
        order, other_order = other_order, order
    return order


@inlined_kernel
def ellipse_span(
    low: float, high: float, extent: float, summit: float, half_width: float, slope: float
) -> tuple[float, float]:
    """The extent of an ellipse around the origin across a band ``low`` … ``high`` of its coordinate s.

    The ellipse lives on s in ± ``extent``; there it spans t = slope · s ± half_width · √(1 − (s / extent)²)
    and t is greatest at ``summit``. Returns the least and the greatest t; empty when least > greatest.
    """
    if low > extent or high < -extent:
        return F(1), F(-1)
    inverse = F(1) / extent
    s = min(max(summit, low), high)
    greatest = slope * s + half_width * math.sqrt(max(F(1) - (s * inverse) ** 2, F(0)))
    s = min(max(-summit, low), high)
    least = slope * s - half_width * math.sqrt(max(F(1) - (s * inverse) ** 2, F(0)))
    return least, greatest


@kernel
def _tile_range(low: float, high: float, tiles: int, side: int) -> tuple[int, int]:
    """First and last + 1 of ``tiles`` tiles, of ``side`` px, that an interval in px touches."""
    if high < F(-SLACK_PX) or low > high:
        return 0, 0
    first = int(max(low - SLACK_PX, F(0)) / F(side))
    return first, min(int(min((high + SLACK_PX) / F(side), F(tiles))) + 1, tiles)


@kernel
def tile_box(splat: Floats, tiles_x: int, tiles_y: int, side: int) -> tuple[int, int, int, int]:
    """First and last + 1 column, first and last + 1 row of the tiles that the splat's box touches."""
    x, y, extent_x, extent_y = splat[CENTER_X], splat[CENTER_Y], splat[EXTENT_X], splat[EXTENT_Y]
    first_column, end_column = _tile_range(x - extent_x, x + extent_x, tiles_x, side)
    first_row, end_row = _tile_range(y - extent_y, y + extent_y, tiles_y, side)
    return first_column, end_column, first_row, end_row


@kernel
def tile_columns(splat: Floats, row: int, first_column: int, end_column: int, side: int) -> tuple[int, int]:
    """First and last + 1 tile of those columns that the splat's ellipse touches in a row of tiles."""
    top = F(row * side) - splat[CENTER_Y] - SLACK_PX
    bottom = top + F(side) + F(2) * SLACK_PX
    rightmost = splat[SLOPE_Y] * splat[EXTENT_X]
    left, right = ellipse_span(top, bottom, splat[EXTENT_Y], rightmost, splat[WIDTH], splat[SLOPE_X])
    first, end = _tile_range(splat[CENTER_X] + left, splat[CENTER_X] + right, end_column, side)
    first = max(first, first_column)
    return first, max(first, end)


@inlined_kernel
def _strip_span(splat: Floats, left: float) -> tuple[float, float]:
    """The range of y, in px, that the ellipse covers in a strip of ``LANES`` pixels from ``left`` on.

    Empty when the first is greater. The same for all tiles of a column, each takes its part (``_clip``).
    """
    low = left - splat[CENTER_X] + F(0.5) - SLACK_PX
    high = low + F(LANES - 1) + F(2) * SLACK_PX
    lowest = splat[SLOPE_X] * splat[EXTENT_Y]
    least, greatest = ellipse_span(low, high, splat[EXTENT_X], lowest, splat[HEIGHT], splat[SLOPE_Y])
    if least > greatest:
        return F(1), F(-1)
    middle = splat[CENTER_Y] - F(0.5)
    return middle + least - SLACK_PX, middle + greatest + SLACK_PX


@inlined_kernel
def _clip(span: Floats, top: float) -> tuple[int, int]:
    """First and last + 1 pixel row, in the tile that begins at ``top``, of what a strip's span covers."""
    if span[0] > span[1]:
        return 0, 0
    first = math.ceil(min(max(span[0] - top, F(0)), F(TILE_PX)))
    last = math.floor(max(min(span[1] - top, F(TILE_PX - 1)), F(-1)))
    return int(first), int(last) + 1


@parallel_kernel
def gather(records: Floats, order: NDArray[np.int64]) -> Floats:
    """The records [V, 16] in depth order: neighbours in a tile's list are then neighbours in memory."""
    splats = np.empty((order.size, RECORD_SIZE), np.float32)
    for i in numba.prange(order.size):
        for j in range(RECORD_SIZE):
            splats[i, j] = records[order[i], j]
    return splats


@parallel_kernel
def bin_splats(
    splats: Floats, tiles_x: int, tiles_y: int, parts: int
) -> tuple[NDArray[np.int64], Ints, NDArray[np.uint8], Ints, NDArray[np.int64]]:
    """Deal V depth-sorted splats to tiles in ``parts`` pieces of work; any number gives the same lists.

    Near splats come first and touch most tiles: several parts per thread, taken one at a time, share the
    work more evenly than one each.

    Returns ``tile_starts`` [T + 1] into the lists, then in tile order ``hit_splats`` [H], ``hit_rows``
    [H, 4] (first and last + 1 pixel row that the ellipse touches in the tile's left and right half) and
    ``hit_numbers`` [H], and ``splat_starts`` [V + 1], the first hit number of every splat.
    """
    count, tiles = splats.shape[0], tiles_x * tiles_y
    hits_of_splat = np.empty(count + 1, np.int64)
    hits_of_splat[0] = 0
    counts = np.empty((parts, tiles), np.int64)
    for part in numba.prange(parts):
        for tile in range(tiles):
            counts[part, tile] = 0
        for i in range(part * count // parts, (part + 1) * count // parts):
            splat = splats[i]
            first_column, end_column, first_row, end_row = tile_box(splat, tiles_x, tiles_y, TILE_PX)
            hits = 0
            for row in range(first_row, end_row):
                first, end = tile_columns(splat, row, first_column, end_column, TILE_PX)
                for column in range(first, end):
                    counts[part, row * tiles_x + column] += 1
                hits += end - first
            hits_of_splat[i + 1] = hits
    for i in range(count):
        hits_of_splat[i + 1] += hits_of_splat[i]
    tile_starts = np.empty(tiles + 1, np.int64)
    total = 0
    for tile in range(tiles):
        tile_starts[tile] = total
        for part in range(parts):
            hits = counts[part, tile]
            counts[part, tile] = total
            total += hits
    tile_starts[tiles] = total

    hit_splats = np.empty(total, np.int32)
    hit_numbers = np.empty(total, np.int32)
    hit_rows = np.empty((total, 2 * HALVES), np.uint8)
    for part in numba.prange(parts):
        spans = np.empty((HALVES * tiles_x, 2), np.float32)
        for i in range(part * count // parts, (part + 1) * count // parts):
            splat = splats[i]
            number = hits_of_splat[i]
            first_column, end_column, first_row, end_row = tile_box(splat, tiles_x, tiles_y, TILE_PX)
            for strip in range(HALVES * first_column, HALVES * end_column):
                spans[strip, 0], spans[strip, 1] = _strip_span(splat, F(strip * LANES))
            for row in range(first_row, end_row):
                first, end = tile_columns(splat, row, first_column, end_column, TILE_PX)
                for column in range(first, end):
                    slot = counts[part, row * tiles_x + column]
                    counts[part, row * tiles_x + column] = slot + 1
                    hit_splats[slot] = i
                    hit_numbers[slot] = number
                    for half in range(HALVES):
                        first_px, end_px = _clip(spans[HALVES * column + half], F(row * TILE_PX))
                        hit_rows[slot, 2 * half], hit_rows[slot, 2 * half + 1] = first_px, end_px
                    number += 1
    return tile_starts, hit_splats, hit_rows, hit_numbers, hits_of_splat
