"""Blend the hits of every tile front to back. Nearly all of a rendering's time is spent in its inner loop.

One warp blends one tile; a lane holds 4 pixels that are neighbours in a row, so that what depends on the row
is computed once for them. What the loop costs is instructions, 87 per hit and warp, not memory:

* the record of a splat is read while the one before it is blended, into the registers that one has done with;
* the square root of log₂ e is part of the factors of the ellipse, so the exponential is one instruction;
* a finished pixel keeps its transmittance with a negative sign: no mask, no second register;
* 49 to 64 registers let as many warps run on a multiprocessor as it has room for blocks, 32.

Read per hit: 4 bytes of the list and 36 of the record (40 with depth), mostly from the caches; written per
pixel: 16 bytes, 20 with depth.
"""

import math

import torch
import triton
import triton.language as tl
from torch import Tensor

from fvs_engine.splat import conventions
from fvs_engine.splat.triton_kernels.binning import Hits
from fvs_engine.splat.triton_kernels.projection import Projected
from fvs_engine.splat.triton_kernels.tiles import TILE_HEIGHT, TILE_WIDTH, tile_counts

CHECK_EVERY = tl.constexpr(16)
"""Hits between two checks whether the whole tile is finished."""

LANES = tl.constexpr(32)
NEIGHBOURS = tl.constexpr(TILE_WIDTH * TILE_HEIGHT // 32)
"""Pixels of a lane."""
PIXELS = tl.constexpr(TILE_WIDTH * TILE_HEIGHT)
STRIPS = tl.constexpr(TILE_WIDTH // NEIGHBOURS.value)
"""Lanes of a row."""
TILE_W, TILE_H = tl.constexpr(TILE_WIDTH), tl.constexpr(TILE_HEIGHT)

RECORD = tl.constexpr(conventions.RECORD_SIZE)
CENTER_X, CENTER_Y = tl.constexpr(conventions.CENTER_X), tl.constexpr(conventions.CENTER_Y)
FACTOR_A, FACTOR_K = tl.constexpr(conventions.FACTOR_A), tl.constexpr(conventions.FACTOR_K)
FACTOR_B = tl.constexpr(conventions.FACTOR_B)
OPACITY, DEPTH = tl.constexpr(conventions.OPACITY), tl.constexpr(conventions.DEPTH)
RED, GREEN, BLUE = (tl.constexpr(i) for i in (conventions.RED, conventions.GREEN, conventions.BLUE))

LEAST_ALPHA, MOST_ALPHA = tl.constexpr(conventions.ALPHA_MIN), tl.constexpr(conventions.ALPHA_MAX)
LEAST_T = tl.constexpr(conventions.TRANSMITTANCE_MIN)
SQRT_LOG2_E = tl.constexpr(math.sqrt(math.log2(math.e)))


def blend(
    projected: Projected, hits: Hits, size: tuple[int, int], *, depth: bool
) -> tuple[Tensor, Tensor, Tensor | None]:
    """Color [C, H, W, 3], alpha [C, H, W] and, where it is asked for, depth [C, H, W]; see ``Rendering``."""
    cameras, count = projected.radii.shape
    width, height = size
    new = torch.empty if count > 0 else torch.zeros
    alpha = new((cameras, height, width), dtype=torch.float32, device=projected.records.device)
    color = new((cameras, height, width, 3), dtype=torch.float32, device=alpha.device)
    depths = new(alpha.shape, dtype=torch.float32, device=alpha.device) if depth else None
    tiles_x, tiles_y = tile_counts(size)
    tiles = tiles_x * tiles_y
    if count > 0:
        _blend[(cameras * tiles,)](
            projected.records, hits.listed, hits.tile_starts, color, alpha, width, height, tiles_x, tiles,
            depths, num_warps=1,
        )  # fmt: skip
    return color, alpha, depths


@triton.jit
def tile_pixels(width, height, tiles_x, tiles):
    """The centres in px of every lane's first pixel, x [32] and y [32], and where pixels lie in images.

    That is their place in a plane of all cameras [128], whose reshape to [4, 32] is that of the lanes, and
    whether they lie inside of the image [128].
    """
    tile = tl.program_id(0)
    camera = tile // tiles
    left, top = tile % tiles % tiles_x * TILE_W, tile % tiles // tiles_x * TILE_H
    lane = tl.arange(0, LANES)
    x = (left + lane % STRIPS * NEIGHBOURS).to(tl.float32) + 0.5
    y = (top + lane // STRIPS).to(tl.float32) + 0.5
    # One dimension for what is in memory: in two, the compiler may choose another layout, and carry all
    # values of the inner loop over to it.
    pixel = tl.arange(0, PIXELS)
    row = top + pixel % LANES // STRIPS
    column = left + pixel % STRIPS * NEIGHBOURS + pixel // LANES
    place = (camera * height + row).to(tl.int64) * width + column
    return x, y, place, (row < height) & (column < width)


@triton.jit
def by_lanes(values):
    """Values of a tile's pixels [128] as the inner loop has them [4, 32]."""
    return tl.reshape(values, (NEIGHBOURS, LANES))


@triton.jit
def in_memory(values):
    """Values of a tile's pixels [4, 32] as they are written [128]."""
    return tl.reshape(values, (PIXELS,))


@triton.jit
def falloff(center_x, center_y, a, k, b, x, y):
    """Offsets u = dx − k dy and dy [32] of every lane's first pixel, and exp(−exponent) [4, 32]."""
    a, b = a * SQRT_LOG2_E, b * SQRT_LOG2_E
    dy = y - center_y
    u = x - center_x - k * dy
    first, across = a * u, b * dy
    along = first[None, :] + a * neighbours()
    return u, dy, tl.exp2((along * along + (across * across)[None, :]) * -1.0)


@triton.jit
def neighbours():
    """The lane's pixels, 0 to 3 px to the right of its first, [4, 1]."""
    return tl.arange(0, NEIGHBOURS)[:, None].to(tl.float32)


@triton.jit
def blended(raw, light):
    """Weights of a splat, and the light that it lets through, where its alpha is ``raw`` before clamping.

    Where that light would be too little, the pixel is finished and its weight is 0.
    """
    alpha = tl.where(raw >= LEAST_ALPHA, tl.minimum(raw, MOST_ALPHA), 0.0)
    behind = light - light * alpha
    return tl.where(behind > LEAST_T, light * alpha, 0.0), behind


@triton.jit
def is_finished(light):
    """Whether no pixel of the tile lets light through: light is negative where a pixel is finished."""
    return tl.max(tl.max(light, axis=0), axis=0) <= 0.0


@triton.jit(do_not_specialize=["width", "height", "tiles_x", "tiles"])
def _blend(
    records, listed, tile_starts, color_image, alpha_image, width, height, tiles_x, tiles, depth_image
):
    x, y, place, inside = tile_pixels(width, height, tiles_x, tiles)
    light = by_lanes(tl.where(inside, 1.0, -1.0))
    color_sum_r = tl.zeros((NEIGHBOURS, LANES), tl.float32)
    color_sum_g, color_sum_b, depth_sum = color_sum_r, color_sum_r, color_sum_r

    slot, end = tl.load(tile_starts + tl.program_id(0)), tl.load(tile_starts + tl.program_id(0) + 1)
    # Slots behind the tile's are read and not used; they exist (binning.PREFETCHED).
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
            _, _, gauss = falloff(center_x, center_y, a, k, b, x, y)
            raw = opacity * gauss
            center_x, center_y = tl.load(record + CENTER_X), tl.load(record + CENTER_Y)
            a, k, b = tl.load(record + FACTOR_A), tl.load(record + FACTOR_K), tl.load(record + FACTOR_B)
            opacity = tl.load(record + OPACITY)
            weight, behind = blended(raw, light)
            light = tl.where(behind > LEAST_T, behind, tl.abs(light) * -1.0)
            color_sum_r += weight * red
            color_sum_g += weight * green
            color_sum_b += weight * blue
            red, green, blue = tl.load(record + RED), tl.load(record + GREEN), tl.load(record + BLUE)
            if depth_image is not None:
                depth_sum += weight * depth
                depth = tl.load(record + DEPTH)
            slot += 1
        if is_finished(light):
            slot = end

    tl.store(color_image + place * 3, in_memory(color_sum_r), mask=inside)
    tl.store(color_image + place * 3 + 1, in_memory(color_sum_g), mask=inside)
    tl.store(color_image + place * 3 + 2, in_memory(color_sum_b), mask=inside)
    tl.store(alpha_image + place, in_memory(1.0 - tl.abs(light)), mask=inside)
    if depth_image is not None:
        tl.store(depth_image + place, in_memory(depth_sum), mask=inside)
