"""The gradient of blending, one row per hit: no atomics, so the sums over a splat's hits are deterministic.

It walks front to back, as ``blending`` does and with the same arithmetic, keeping the part of the sum that
lies behind each pixel's splat: it stops where the forward pass stopped and divides by nothing that can be 0.

The inner loop costs 216 instructions per hit and warp where the loss uses colour alone; 64 registers then let
as many warps run on a multiprocessor as it has room for blocks, 32 (with all images 233 and 72).

A lane adds up its 4 pixels in moments of their offset, so that 9 numbers per lane are left (10 with depth).
To add these up over the 32 lanes, each lane passes half of its numbers on and keeps half, while there is more
than one: 12 shuffles, where number by number takes 45.

Read per hit: 8 bytes of the lists and 36 of the record (40 with depth); written: its row of 40 bytes. Read
per pixel: 24 bytes, and 8 more each with gradients of alpha and depth.
"""

import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat.conventions import GRADIENT_SIZE
from fvs_engine.splat.triton_kernels.binning import Hits
from fvs_engine.splat.triton_kernels.blending import (
    BLUE,
    CENTER_X,
    CENTER_Y,
    CHECK_EVERY,
    DEPTH,
    FACTOR_A,
    FACTOR_B,
    FACTOR_K,
    GREEN,
    LANES,
    LEAST_T,
    MOST_ALPHA,
    OPACITY,
    RECORD,
    RED,
    blended,
    by_lanes,
    falloff,
    is_finished,
    neighbours,
    tile_pixels,
)
from fvs_engine.splat.triton_kernels.projection import Projected
from fvs_engine.splat.triton_kernels.tiles import tile_counts

ROW = tl.constexpr(GRADIENT_SIZE)
ROW_BLOCK = tl.constexpr(16)
"""A row's numbers, and some that are none: a tensor's side is a power of two."""
ROWS_AT_ONCE = tl.constexpr(16)
MISSED_BLOCK = 64
MISSED_PROGRAMS = 1024

Images = tuple[Tensor, Tensor, Tensor | None]
"""Color [C, H, W, 3], alpha [C, H, W] and depth [C, H, W]."""
ImageGradients = tuple[Tensor, Tensor | None, Tensor | None]
"""Of a loss by these images, contiguous; None where it does not use one."""


def blend_backward(
    projected: Projected, hits: Hits, images: Images, image_gradients: ImageGradients
) -> Tensor:
    """The gradients of the records' first numbers by hit: rows [capacity, 10], in the order of hit numbers.

    ``images`` are what ``blend`` rendered. Rows behind the last hit are not written.
    """
    color, alpha, depth = images
    g_color, g_alpha, g_depth = image_gradients
    cameras, height, width, _ = color.shape
    rows = color.new_empty((hits.capacity, GRADIENT_SIZE))
    if hits.capacity == 0:
        return rows
    tiles_x, tiles_y = tile_counts((width, height))
    tiles = tiles_x * tiles_y
    _blend_backward[(cameras * tiles,)](
        projected.records, hits.listed, hits.numbers, hits.tile_starts, rows,
        color, g_color, width, height, tiles_x, tiles,
        None if g_alpha is None else alpha, g_alpha,
        None if g_depth is None else depth, g_depth, num_warps=1,
    )  # fmt: skip
    programs = min(MISSED_PROGRAMS, triton.cdiv(hits.capacity, MISSED_BLOCK))
    _clear_missed[(programs,)](
        hits.numbers, hits.tile_starts, hits.starts, rows,
        cameras * tiles, len(hits.starts) - 1, hits.capacity, programs, BLOCK=MISSED_BLOCK,
    )  # fmt: skip
    return rows


@triton.jit
def _halve(even, odd, lane, BIT: tl.constexpr):
    """One number of two per lane, ``odd`` in lanes with this bit: the sum over the two lanes of a pair."""
    is_odd = (lane & BIT) != 0
    kept, given = tl.where(is_odd, odd, even), tl.where(is_odd, even, odd)
    return kept + tl.gather(given, lane ^ BIT, 0)


@triton.jit
def _fold(number, lane, BIT: tl.constexpr):
    """The sum of a number in both lanes of a pair."""
    return number + tl.gather(number, lane ^ BIT, 0)


@triton.jit
def sum_of_lanes(n0, n1, n2, n3, n4, n5, n6, n7, n8, n9, lane):
    """The sums over all lanes of ten numbers per lane [32]: that of number i in lane i."""
    n0, n2, n4 = _halve(n0, n1, lane, 1), _halve(n2, n3, lane, 1), _halve(n4, n5, lane, 1)
    n6, n8 = _halve(n6, n7, lane, 1), _halve(n8, n9, lane, 1)
    n0, n4, n8 = _halve(n0, n2, lane, 2), _halve(n4, n6, lane, 2), _fold(n8, lane, 2)
    n0, n8 = _halve(n0, n4, lane, 4), _fold(n8, lane, 4)
    return _fold(_halve(n0, n8, lane, 8), lane, 16)


@triton.jit
def _clear_rows(rows, numbers, slots, end):
    """Write zeros to the rows of the hits in ``slots`` that are before ``end``."""
    inside = slots < end
    number = tl.load(numbers + slots, mask=inside, other=0).to(tl.int64)
    column = tl.arange(0, ROW_BLOCK)
    zeros = tl.zeros((slots.shape[0], ROW_BLOCK), tl.float32)
    mask = inside[:, None] & (column < ROW)[None, :]
    tl.store(rows + number[:, None] * ROW + column[None, :], zeros, mask=mask)


@triton.jit(do_not_specialize=["width", "height", "tiles_x", "tiles"])
def _blend_backward(
    records,
    listed,
    numbers,
    tile_starts,
    rows,
    color_image,
    color_gradient,
    width,
    height,
    tiles_x,
    tiles,
    alpha_image,
    alpha_gradient,
    depth_image,
    depth_gradient,
):
    x, y, place, inside = tile_pixels(width, height, tiles_x, tiles)
    lane = tl.arange(0, LANES)
    beside = neighbours()
    light = by_lanes(tl.where(inside, 1.0, -1.0))
    g_red = by_lanes(tl.load(color_gradient + place * 3, mask=inside, other=0.0))
    g_green = by_lanes(tl.load(color_gradient + place * 3 + 1, mask=inside, other=0.0))
    g_blue = by_lanes(tl.load(color_gradient + place * 3 + 2, mask=inside, other=0.0))
    # What lies behind the splats so far, as the loss sees it: at first the whole pixel.
    rest = g_red * by_lanes(tl.load(color_image + place * 3, mask=inside, other=0.0))
    rest += g_green * by_lanes(tl.load(color_image + place * 3 + 1, mask=inside, other=0.0))
    rest += g_blue * by_lanes(tl.load(color_image + place * 3 + 2, mask=inside, other=0.0))
    if alpha_gradient is not None:
        g_alpha = by_lanes(tl.load(alpha_gradient + place, mask=inside, other=0.0))
        rest += g_alpha * by_lanes(tl.load(alpha_image + place, mask=inside, other=0.0))
    if depth_gradient is not None:
        g_depth = by_lanes(tl.load(depth_gradient + place, mask=inside, other=0.0))
        rest += g_depth * by_lanes(tl.load(depth_image + place, mask=inside, other=0.0))

    slot, end = tl.load(tile_starts + tl.program_id(0)), tl.load(tile_starts + tl.program_id(0) + 1)
    hidden = end
    # Each splat's record is read while the one before it is differentiated, as in blending.
    record = records + tl.load(listed + slot).to(tl.int64) * RECORD
    next_splat = tl.load(listed + slot + 1)
    center_x, center_y = tl.load(record + CENTER_X), tl.load(record + CENTER_Y)
    a, k, b = tl.load(record + FACTOR_A), tl.load(record + FACTOR_K), tl.load(record + FACTOR_B)
    opacity = tl.load(record + OPACITY)
    red, green, blue = tl.load(record + RED), tl.load(record + GREEN), tl.load(record + BLUE)
    depth = tl.load(record + DEPTH)
    while slot < end:
        stop = tl.minimum(slot + CHECK_EVERY, end)
        while slot < stop:
            record = records + next_splat.to(tl.int64) * RECORD
            next_splat = tl.load(listed + slot + 2)
            row = rows + tl.load(numbers + slot).to(tl.int64) * ROW

            u, dy, gauss = falloff(center_x, center_y, a, k, b, x, y)
            raw = opacity * gauss
            weight, behind = blended(raw, light)
            light = tl.where(behind > LEAST_T, behind, -1.0)
            value = red * g_red + green * g_green + blue * g_blue
            if alpha_gradient is not None:
                value += g_alpha
            if depth_gradient is not None:
                value += depth * g_depth
            rest -= weight * value
            # alpha · ∂L/∂alpha; nothing flows through a clamped or skipped alpha. A root is one instruction.
            root = tl.rsqrt(tl.abs(behind))
            flow = tl.where(raw <= MOST_ALPHA, weight * (value - rest * (root * root)), 0.0)

            # With u = u₀ + i in the lane's pixel i: exponent = (a u)² + (b dy)², and ∂L/∂exponent = −flow.
            s = tl.sum(flow, axis=0)
            s1 = tl.sum(flow * beside, axis=0)
            su = u * s + s1
            suu = u * (su + s1) + tl.sum(flow * (beside * beside), axis=0)
            sy = dy * s
            root = tl.rsqrt(opacity)
            of_x = (2.0 * a * a) * su
            of_y = (2.0 * b * b) * sy - k * of_x
            of_a, of_k, of_b = (-2.0 * a) * suu, dy * of_x, (-2.0 * b) * (dy * sy)
            of_opacity = (root * root) * s
            of_depth = tl.zeros_like(s)
            if depth_gradient is not None:
                of_depth = tl.sum(weight * g_depth, axis=0)
                depth = tl.load(record + DEPTH)
            center_x, center_y = tl.load(record + CENTER_X), tl.load(record + CENTER_Y)
            a, k, b = tl.load(record + FACTOR_A), tl.load(record + FACTOR_K), tl.load(record + FACTOR_B)
            opacity = tl.load(record + OPACITY)
            red, green, blue = tl.load(record + RED), tl.load(record + GREEN), tl.load(record + BLUE)
            total = sum_of_lanes(
                of_x, of_y, of_a, of_k, of_b, of_opacity,
                tl.sum(weight * g_red, axis=0), tl.sum(weight * g_green, axis=0),
                tl.sum(weight * g_blue, axis=0), of_depth, lane,
            )  # fmt: skip
            tl.store(row + lane, total, mask=lane < ROW)
            slot += 1
        if is_finished(light):
            hidden, slot = slot, end

    while hidden < end:
        _clear_rows(rows, numbers, hidden + tl.arange(0, ROWS_AT_ONCE), end)
        hidden += ROWS_AT_ONCE


@triton.jit(do_not_specialize=["all_tiles", "splats", "capacity", "programs"])
def _clear_missed(
    numbers, tile_starts, starts, rows, all_tiles, splats, capacity, programs, BLOCK: tl.constexpr
):
    """Write zeros to the rows of hits whose tile the ellipse misses; they are listed behind all tiles."""
    end = tl.minimum(tl.load(starts + splats), capacity).to(tl.int32)
    slot = tl.load(tile_starts + all_tiles) + tl.program_id(0) * BLOCK
    while slot < end:
        _clear_rows(rows, numbers, slot + tl.arange(0, BLOCK), end)
        slot += programs * BLOCK
